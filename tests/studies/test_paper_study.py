"""The paper's study and the audit of its numbers, recomputed (DESIGN section 3)."""

import numpy as np
import pytest
from scipy import stats

import independent
from tumblecal.data import paper
from tumblecal.studies.paper_audit import audit


@pytest.fixture(scope="module")
def audited(table1_fit):
    return audit(table1_fit)


def published_residuals(table1, values) -> np.ndarray:
    setting = np.repeat([0, 1, 2], 8)
    return table1.readings - independent.nominal(np.asarray(values), table1.alpha, table1.beta, setting)


def test_simulation_truth_explains_the_measured_table(audited, table1, table1_fit):
    truth = audited.explanations[0]
    assert truth.dof == (15, 57)
    assert round(truth.f, 2) == 1.14 and round(truth.p_value, 2) == 0.34
    residuals = published_residuals(table1, list(paper.SIMULATION_TRUTH.values()))
    np.testing.assert_allclose(truth.residuals, residuals, rtol=0, atol=1e-14)
    least = np.sum(table1_fit.residuals**2)
    f = (np.sum(residuals**2) - least) / 15 / (least / 57)
    assert truth.f == pytest.approx(f, rel=1e-6)
    assert truth.p_value == pytest.approx(stats.f.sf(f, 15, 57), rel=1e-5)


def test_published_result_of_the_first_run_does_not(audited, table1):
    """p about 1e-67, residuals up to 2.6 mg; Table 3 states half a milli-g."""
    run = audited.explanations[1]
    assert run.name == "Table 2, run 1"
    assert -68 < np.log10(run.p_value) < -66
    assert round(run.largest_residual_g * 1e3, 2) == 2.64 and round(run.smallest_residual_g * 1e3, 2) == -2.44
    values = [paper.table2()[name][0] for name in paper.SIMULATION_TRUTH]
    np.testing.assert_allclose(run.residuals, published_residuals(table1, values), rtol=0, atol=1e-14)
    assert [round(value * 1e3, 1) for value in audited.published_extremes_g] == [0.5, -0.5]


def test_noise_is_far_below_what_is_stated(audited):
    noise = audited.noise
    assert round(noise.observed_g * 1e3, 4) == 0.0978 and noise.dof == 57
    # 0.7 mg over 100 s, white beyond: sqrt(12) less over 20 minutes; a floor keeps it near 0.69 mg.
    assert noise.implied_white_beyond_100s_g * 1e3 == pytest.approx(0.7 / np.sqrt(12), rel=1e-12)
    assert round(noise.implied_floor_g * 1e3, 2) == 0.69
    assert noise.p_value == pytest.approx(
        stats.chi2.cdf(57 * (noise.observed_g / noise.implied_white_beyond_100s_g) ** 2, 57), rel=1e-9
    )
    assert noise.p_value < 1e-6


def test_every_method_finds_the_truth_within_its_own_sd(study):
    """The first-order bias (2e-6) is far below the sd of one set; over 600 sets it is below 0.3 sd of the mean."""
    sd = study.single_sd / np.sqrt(600)
    for estimates in (study.mean, study.exact_mean, study.kalman, study.diffuse):
        assert np.max(np.abs(estimates[-1] - study.truth) / sd) < 4.5
    np.testing.assert_allclose(np.std(study.single, axis=0, ddof=1), study.single_sd, rtol=4.5 / np.sqrt(1198))
    np.testing.assert_allclose(np.std(study.exact, axis=0, ddof=1), study.single_sd, rtol=4.5 / np.sqrt(1198))
    np.testing.assert_allclose(study.kalman_sd[-1], sd, rtol=0.1)
