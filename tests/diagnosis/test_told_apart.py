"""One gross mistake, two causes that are nearly alike, and a coefficient that no reading shows: each is told from the rest."""

import numpy as np
import pytest

import blind_instrument as blind
from blind_noise import position_set
from tumblecal.report.diagnosis_verdict import verdict_of_diagnosis


@pytest.mark.parametrize(
    ("names", "known"),
    [(("bias_drift.y", "bias_temperature.y"), True), (("scale_drift.x", "scale_temperature.x"), False)],
)
def test_two_strong_effects_that_are_nearly_alike_are_both_named(diagnoser, names, known):
    """What is left of the second beside the first decides, not its share: with less than 14 % left one of them alone was
    named, and the rest was taken for noise, stated or not."""
    for seed in range(2):
        rng = np.random.default_rng([14, seed])
        setup = blind.random_setup(rng, 3, 8)
        hours = (setup.time_s - setup.time_s.mean()) / 3600.0
        setup.temperature_degc = 25.0 + 2.0 * hours + 0.08 * np.std(hours) * rng.normal(size=24)
        projector, plain = blind.unreachable(setup), blind.readings(setup, setup.nominal, {})
        white = {}
        for name in names:
            coefficients = np.ones(blind.COEFFICIENTS[name]) * 1e-3
            signal = (blind.readings(setup, setup.nominal, {name: coefficients}) - plain).ravel() / blind.SIGMA
            white[name] = projector @ signal
        first, second = (white[name] / np.linalg.norm(white[name]) for name in names)
        left = np.sqrt(1.0 - (first @ second) ** 2)
        assert 0.02 < left < 0.14
        sizes = {name: 20.0 / left / np.linalg.norm(white[name]) for name in names}
        effects = {name: np.ones(blind.COEFFICIENTS[name]) * 1e-3 * sizes[name] for name in names}
        readings = blind.readings(setup, setup.nominal, effects) + blind.SIGMA * rng.normal(size=(24, 3))
        diagnosis = diagnoser(position_set(setup, readings, known))
        assert set(diagnosis.labels) == {*names}, (seed, diagnosis.labels)


@pytest.mark.parametrize("seed", [2, 8])
def test_a_position_inside_a_dead_zone_is_no_accident(diagnoser, seed):
    """A jump at zero input and a disturbed position were named, surely: the output is zero elsewhere than the input."""
    rng = np.random.default_rng([16, seed])
    setup = blind.random_setup(rng, 3, 8)
    setup.nominal["bias"] = np.array([0.006, -0.004, 0.005])
    readings, width = blind.readings(setup, setup.nominal, {}), 0.012
    readings[:, 1] = np.sign(readings[:, 1]) * np.maximum(np.abs(readings[:, 1]) - width, 0.0)
    diagnosis = diagnoser(position_set(setup, readings + blind.SIGMA * rng.normal(size=(24, 3)), known=False))
    assert {label.partition(":")[0] for label in diagnosis.labels} == {"bias_asymmetry.y", "outlier_position"}
    assert (
        diagnosis.verdict == "ambiguous"
        and "close to zero input of a jump. A dead zone" in verdict_of_diagnosis(diagnosis).words()
    )


def test_priors_that_alone_are_contradicted_are_said_and_left_out(diagnoser):
    """Pitch settings set anew since the head was measured were something "constant at a pitch setting" without a name."""
    rng = np.random.default_rng(61)
    setup = blind.random_setup(rng, 3, 8)
    setup.nominal["dbeta"] = np.array([1.1e-3, -0.9e-3, 0.02e-3])
    readings = blind.readings(setup, setup.nominal, {})
    data = position_set(setup, readings + blind.SIGMA * rng.normal(size=readings.shape), known=False)
    diagnosis = diagnoser(data, noise_sd=blind.SIGMA, priors={"dbeta": (0.0, 3e-5)})
    told = {unusual.parameter: unusual.stated_sd for unusual in diagnosis.implausible}
    assert set(told) == {"dbeta_0", "dbeta_1"} and told["dbeta_0"] == pytest.approx(0.03)
    assert diagnosis.labels == () and diagnosis.screened.detection.p_value > 1e-3
    assert (
        "without these stated values the data are consistent with the nominal model"
        in verdict_of_diagnosis(diagnosis).words()
    )
    kept = diagnosis.problem
    assert kept.priors == 1 and kept.prior_root @ np.ones(len(kept.chain.names)) == pytest.approx([1 / 3e-5])
