"""Positions, and stated priors, that the rest of a fit contradicts; and what is then said of the use."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import blind_instrument as blind
import blind_sets
from few_effects import few_entries
from tumblecal.estimation import exact, problem_of
from tumblecal.estimation.contradicted import priors_p_value
from tumblecal.estimation.leave_out import contradicted
from tumblecal.estimation.methods import all_methods


SD_BIAS = 1e-3


def measured(seed, pitches=3, bias=None):
    """Positions of an instrument whose biases are as large as their prior says, or as given."""
    rng = np.random.default_rng([51, seed])
    setup = blind.random_setup(rng, pitches, 8)
    setup.nominal["bias"] = SD_BIAS * rng.normal(size=3) if bias is None else np.array(bias)
    return blind_sets.measured(setup, {}, rng, known=False)


def calibrated_of(problem):
    """All methods, judged by a catalogue of few effects."""
    return replace(all_methods(problem), entries=few_entries())


def test_p_values_are_uniform_where_nothing_is_wrong():
    priors, alarms = [], 0
    for seed in range(120):
        data = measured(seed)
        fit = exact.fit(problem_of(data, noise_sd=blind.SIGMA, priors={"bias": (0.0, SD_BIAS)}))
        priors.append(priors_p_value(fit))
        if seed < 60:
            alarms += bool(contradicted(fit if seed % 2 else exact.fit(problem_of(data)), false_alarms=0.2))
    # 12 of 120 are expected below 0.1: more than 22 once in a thousand. Half of the alarms are those of single positions, to
    # Bonferroni's bound (6 of 60); exchanged rows must agree in addition.
    assert 2 <= np.sum(np.array(priors) < 0.1) <= 22 and 1 <= alarms <= 14


def test_the_statistic_of_the_priors_is_what_they_add_to_the_sum_of_squares():
    """Chi-square of three for the biases: the fit with their priors less that without."""
    for seed in range(4):
        data = measured(seed)
        fit = exact.fit(problem_of(data, noise_sd=blind.SIGMA, priors={"bias": (0.0, SD_BIAS)}))
        added = fit.chi2 - exact.fit(problem_of(data, noise_sd=blind.SIGMA)).chi2
        assert priors_p_value(fit) == pytest.approx(stats.chi2.sf(added, 3), rel=2e-2)


def test_a_prior_that_other_parameters_contradict_is_said():
    """Two pitch settings leave dK_x to the prior of bias_x. That of bias_y and bias_z showed that it is too narrow, and the
    calibration was called usable."""
    bias = np.array([5.0, 3.4, -3.4]) * SD_BIAS
    data = measured(3, pitches=2, bias=bias)
    judged = calibrated_of(problem_of(data, noise_sd=blind.SIGMA, priors={"bias": (0.0, SD_BIAS)})).judgements[0]
    assert judged.tone == "bad" and "contradict each other" in judged.headline
    true = {f"bias_{axis}": (own + 0.5 * SD_BIAS, SD_BIAS) for axis, own in zip("xyz", bias.tolist(), strict=True)}
    (right,) = calibrated_of(problem_of(data, noise_sd=blind.SIGMA, priors=true)).judgements
    assert right.headline == "Usable: the residuals are consistent with the stated noise."


@pytest.mark.parametrize("noise_sd", [None, blind.SIGMA])
def test_a_position_in_error_is_reported(noise_sd):
    """Without a stated noise it was usable as far as the data tell, with a reading in error by seven of the estimated sd."""
    data, clean = measured(1), measured(1)
    shift = (300 if noise_sd is None else 6.5) * blind.SIGMA
    data.readings[9, 1] += shift
    calibrated = calibrated_of(problem_of(data, noise_sd=noise_sd))
    (found,) = calibrated.contradicted
    assert found.positions == (data.names[9],) and found.axis == "y" and found.p_value < 1e-3
    assert found.difference_g == pytest.approx(shift, abs=4.5 * blind.SIGMA)
    # Without it the fit is that of the other positions alone.
    others = exact.fit(problem_of(clean, noise_sd=blind.SIGMA).without((9,)))
    np.testing.assert_allclose(found.fit.values, others.values, atol=0.02 * others.sd.min())
    assert found.fit.dof == others.dof and found.fit.chi2 * (1 if noise_sd else 1e-6 / blind.SIGMA**2) == pytest.approx(
        others.chi2, rel=1e-3
    )
    judged = calibrated.judgements[0]
    assert f"position {data.names[9]}, axis y differs by +" in judged.headline
    assert calibrated.use.refused and judged.tone == "bad"


def test_a_noise_that_is_stated_too_large_and_temperatures_limit_the_use():
    (judged,) = calibrated_of(problem_of(measured(2), noise_sd=10 * blind.SIGMA)).judgements
    assert judged.tone == "open" and "smaller than the stated noise" in judged.headline
    data = replace(measured(2), temperature_degc=np.linspace(24.0, 26.5, 24))
    use = calibrated_of(problem_of(data, noise_sd=blind.SIGMA)).use
    assert (use.answer, use.temperature_degc) == ("within", (24.0, 26.5))
