"""What a calibration states is meant for the middle of what was measured, and its uncertainty holds what is left open."""

from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
from blind.plans import remounted
from blind_sets import measured
from tumblecal.data.sensor_parameters import SENSOR


# Files of each condition; a ramp shares its compiled plan, so that more of them cost little.
FILES = {"two mountings": 2, "a ramp": 12}
# Of bias (g/degC) and scale factor (1/degC), as data sheets have them.
BIAS, SCALE = 5e-5, 6e-5


def two_mountings(rng):
    """One plan twice, the second time turned about z and at 35 instead of 15 degC."""
    setup = remounted(blind.random_setup(rng, 3, 8), ((0, 0, 0), (0, 0, 90)), rng)
    degc = np.where(setup.mounting == 0, 15.0, 35.0) + rng.normal(0, 0.05, len(setup.alpha))
    return replace(setup, temperature_degc=degc)


def ramp(rng):
    """The room warms by 12 degrees while one plan is measured."""
    setup = blind.random_setup(rng, 3, 8)
    rise = np.linspace(-6.0, 6.0, len(setup.alpha))
    return replace(setup, temperature_degc=25.0 + rise - rise.mean())


def in_use(diagnosis):
    """Values and sd of the nine parameters of a written calibration, and the axes whose bias and scale factor have a term of
    temperature."""
    calibration = diagnosis.calibration
    own = calibration.parameters
    at = [own.names.index(name) for name in SENSOR]
    terms = calibration.extra.get("terms", [])
    with_term = {(term["axis"], sum(term["powers"])) for term in terms if term.get("per_degc")}
    return own.values[at], np.sqrt(np.diag(own.covariance))[at], with_term


@pytest.mark.long
@pytest.mark.parametrize("condition", FILES)
def test_intervals_hold_the_truth_where_the_temperature_changes_with_something_else(diagnoser, condition):
    """Coefficients of temperature on all axes; biases were wrong by up to 46 sd, scale factors by 12."""
    off = []
    for seed in range(FILES[condition]):
        rng = np.random.default_rng([seed, 5])
        setup = ramp(rng) if condition == "a ramp" else two_mountings(rng)
        size = {
            f"{kind}_temperature.{axis}": [typical * rng.normal()]
            for kind, typical in {"bias": BIAS, "scale": SCALE}.items()
            for axis in blind.AXES
        }
        data = measured(setup, size, rng)
        if setup.mounting is not None:
            data = replace(data, mount=tuple(np.array(["A", "B"])[setup.mounting].tolist()))
        values, sd, with_term = in_use(diagnoser(data))
        truth = np.concatenate([setup.nominal[kind] for kind in ("dK", "bias", "gamma")])
        warm = np.mean(setup.temperature_degc) - 25.0
        for k, axis in enumerate(blind.AXES):
            truth[k] += warm * size[f"scale_temperature.{axis}"][0] * ((axis, 1) not in with_term)
            truth[3 + k] += warm * size[f"bias_temperature.{axis}"][0] * ((axis, 0) not in with_term)
        off.append(np.abs(values - truth) / sd)
    assert np.max(off) < 5 and np.mean(np.array(off) < 1.96) > 0.85


def test_a_bias_that_drifts_is_written_for_the_mean_time(diagnoser, hidden):
    rate = 3e-3 / 1500
    setup = blind.random_setup(np.random.default_rng(6), 3, 8)
    passed = setup.time_s - setup.time_s[0]
    diagnosis = diagnoser(hidden(6, {"bias_drift.y": [rate]}))
    assert diagnosis.labels == ("bias_drift.y",)
    values, sd, _ = in_use(diagnosis)
    at_mean, own = setup.nominal["bias"][1] + rate * np.mean(passed), SENSOR.index("bias_y")
    assert abs(values[own] - at_mean) < 4 * sd[own] < 0.3 * rate * np.mean(passed)
    assert diagnosis.extended.value("bias_y") == pytest.approx(setup.nominal["bias"][1], abs=4e-4)


def test_where_nothing_is_wrong_and_the_temperature_is_not_known_the_covariance_is_that_of_the_fit(diagnoser, hidden):
    diagnosis = diagnoser(hidden(2, {}, columns=False))
    assert diagnosis.verdict == "adequate"
    np.testing.assert_allclose(diagnosis.in_use.values, diagnosis.extended.values, atol=1e-14)
    ratio = np.diag(diagnosis.in_use.covariance) / np.diag(diagnosis.extended.covariance)
    assert np.all(ratio > 0.99) and np.median(ratio) < 1.3
