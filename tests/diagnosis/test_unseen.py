"""How well parameters are known if effects may be there that were not found: right on average over effects of typical sizes."""

import numpy as np
import pytest

import blind_instrument as blind
from tumblecal.diagnosis import Diagnoser
from tumblecal.effects import catalogue


pytestmark = pytest.mark.long


# Typical sizes of the catalogue in g, s and degC, written down a second time.
TYPICAL = {
    "second_order": 2e-4,
    "third_order": 2e-4,
    "bias_temperature": 1e-4,
    "scale_temperature": 1e-4,
    "bias_drift": 2e-4 / 3600,
}
FILES = 60


# These the nominal parameters of 3 x 8 positions take up: they are told as invisible, with their harm.
INVISIBLE = {"second_order.x", "third_order.x"}
IDS = {f"{name}.{axis}": size for name, size in TYPICAL.items() for axis in blind.AXES}.keys() - INVISIBLE


def drawn(seed: int) -> dict[str, list[float]]:
    rng = np.random.default_rng([seed, 77])
    return {id: [TYPICAL[id.split(".")[0]] * rng.normal()] for id in sorted(IDS)}


@pytest.fixture(scope="module", params=[True, False], ids=["noise stated", "noise unknown"])
def errors(request, hidden):
    """Errors of the sensor's nine parameters in many files, in both standard deviations, and of those that are written in the
    standard uncertainty: (files, 9, 3); and that uncertainty by the first standard deviation."""
    entries = {id: entry for id, entry in catalogue().items() if id in IDS}
    few, rows, ratios = Diagnoser(entries, nested=False), [], []
    for seed in range(FILES):
        setup = blind.random_setup(np.random.default_rng(seed), 3, 8)
        truth = np.concatenate([setup.nominal[kind] for kind in ("dK", "bias", "gamma")])
        # Bias and scale factor are meant at the mean temperature.
        data = hidden(seed, drawn(seed), degc=50 - np.mean(setup.temperature_degc), sd=request.param)
        own = few(data)
        names = [*(f"dK_{a}" for a in "xyz"), *(f"bias_{a}" for a in "xyz"), "gamma_21", "gamma_31", "gamma_32"]
        off = np.array([own.extended.value(name) for name in names]) - truth
        both = off[:, None] / [(own.unseen[name].sd, own.unseen[name].sd_with_unseen) for name in names]
        # What is written is meant for the mean time.
        late = np.mean(setup.time_s) - setup.time_s[0]
        drift = np.array([drawn(seed)[f"bias_drift.{axis}"][0] * late for axis in "xyz"])
        moved = (
            np.array([own.in_use.value(name) for name in names]) - truth - np.concatenate([0 * drift, drift, 0 * drift])
        )
        u = own.in_use.sd[[own.in_use.names.index(name) for name in names]]
        rows.append(np.column_stack([both, moved / u]))
        ratios.append(u / [own.unseen[name].sd for name in names])
    return np.array(rows), np.array(ratios)


def test_the_wider_sd_is_right_and_the_narrower_is_not(errors):
    """The bounds are three sd of what so many files tell."""
    within = np.mean(np.abs(errors[0]) < 2, axis=(0, 1))
    assert 0.91 < within[1] < 0.99 and within[0] < 0.8
    assert np.sqrt(np.mean(errors[0][..., 1] ** 2)) == pytest.approx(1.0, abs=0.17)


def test_the_uncertainty_that_is_written_holds_the_truth_and_is_the_narrower_one(errors):
    """Of effects of typical sizes together; the noise alone holds less than 80 %."""
    off, ratio = errors
    assert 0.91 < np.mean(np.abs(off[..., 2]) < 2) < 0.99
    assert 1.0 < np.median(ratio) < 3.0
