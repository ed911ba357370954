"""A single reading, and stated priors, that the rest of a fit contradicts."""

import numpy as np
import pytest

import blind_instrument as blind
from blind_noise import position_set
from tumblecal.estimation import exact, problem_of
from tumblecal.estimation.contradicted import outlying_reading, priors_p_value
from tumblecal.estimation.methods import all_methods
from tumblecal.report.calibration_words import judgement


SD_BIAS = 1e-3


def measured(seed, pitches=3, bias=None):
    """Positions of an instrument whose biases are as large as their prior says, or as given."""
    rng = np.random.default_rng([51, seed])
    setup = blind.random_setup(rng, pitches, 8)
    setup.nominal["bias"] = SD_BIAS * rng.normal(size=3) if bias is None else np.array(bias)
    readings = blind.readings(setup, setup.nominal, {})
    return position_set(setup, readings + blind.SIGMA * rng.normal(size=readings.shape), known=False)


def test_p_values_are_uniform_where_nothing_is_wrong():
    priors, estimated, stated = [], [], []
    for seed in range(120):
        data = measured(seed)
        fit = exact.fit(problem_of(data, noise_sd=blind.SIGMA, priors={"bias": (0.0, SD_BIAS)}))
        priors.append(priors_p_value(fit))
        stated.append(outlying_reading(fit).p_value)
        estimated.append(outlying_reading(exact.fit(problem_of(data))).p_value)
    for p_values in (priors, estimated, stated):
        # 12 of 120 are expected below 0.1: more than 22 once in a thousand; Bonferroni's bound is a little above.
        assert 2 <= np.sum(np.array(p_values) < 0.1) <= 22


def test_a_prior_that_other_parameters_contradict_is_said():
    """Two pitch settings leave dK_x to the prior of bias_x. That of bias_y and bias_z showed that it is too narrow, and the
    calibration was called usable."""
    bias = np.array([5.0, 3.4, -3.4]) * SD_BIAS
    data = measured(3, pitches=2, bias=bias)
    judged = judgement(all_methods(problem_of(data, noise_sd=blind.SIGMA, priors={"bias": (0.0, SD_BIAS)})))
    assert judged.tone == "bad" and "contradict each other" in judged.headline
    true = {f"bias_{axis}": (own + 0.5 * SD_BIAS, SD_BIAS) for axis, own in zip("xyz", bias.tolist(), strict=True)}
    right = judgement(all_methods(problem_of(data, noise_sd=blind.SIGMA, priors=true)))
    assert right.headline == "Usable: the residuals are what the stated noise makes."


@pytest.mark.parametrize("noise_sd", [None, blind.SIGMA])
def test_one_reading_far_off_is_said(noise_sd):
    """Without a stated noise it was usable as far as the data tell, with a reading off by seven of the estimated sd."""
    data = measured(1)
    data.readings[9, 1] += 300 * blind.SIGMA if noise_sd is None else 5.5 * blind.SIGMA
    judged = judgement(all_methods(problem_of(data, noise_sd=noise_sd)))
    assert judged.tone == "open" and f"position {data.names[9]}, axis y is off by" in judged.headline


def test_a_stated_noise_that_is_too_large_is_said():
    judged = judgement(all_methods(problem_of(measured(2), noise_sd=10 * blind.SIGMA)))
    assert judged.tone == "open" and "smaller than the stated noise" in judged.headline
