"""What the residuals hold that no parameter can reach, against its known distribution."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tumblecal.diagnosis.findings.residuals import QUANTILES, discrepancies, normal_quantiles, predictive


@pytest.fixture(scope="module")
def diagnosis(diagnoser, hidden):
    return diagnoser(hidden(31, {"cross_coupling.y.yz": [8e-4]}, columns=False))


def of_a_right_model(diagnosis, seed):
    """The nominal fit with residuals as pure noise would leave them, by a projection written out."""
    jacobian = diagnosis.nominal.jacobian
    noise = np.random.default_rng(seed).standard_normal(len(jacobian))
    return replace(diagnosis.nominal, rows=noise - jacobian @ np.linalg.lstsq(jacobian, noise, rcond=None)[0])


def test_harmonics_are_counted_in_the_sd_that_they_have(diagnosis):
    draws = [discrepancies(of_a_right_model(diagnosis, seed), 1.0) for seed in range(150)]
    sizes = np.array([[part.in_sd for part in draw if part.in_sd is not None] for draw in draws])
    assert sizes.shape[1] > 60
    # Each one alone is standard normal: 150 draws leave a standard error of 0.12 on its variance, 0.08 on its mean.
    np.testing.assert_allclose(np.mean(sizes**2, axis=0), 1, atol=0.55)
    np.testing.assert_allclose(np.mean(sizes, axis=0), 0, atol=0.35)
    assert abs(np.mean(sizes**2) - 1) < 0.03


def test_a_product_of_y_and_z_is_a_sine_of_twice_alpha_on_y(diagnosis):
    """u_y u_z = cos(beta)^2 sin(2 alpha) / 2: largest at beta 0, gone after the extension."""
    parts = discrepancies(diagnosis.nominal, 1.0)
    worst = max(parts, key=lambda part: abs(part.in_sd or 0.0))
    assert (worst.axis, worst.order, worst.wave, worst.pitch) == ("y", 2, "sin", 0)
    assert worst.in_sd == pytest.approx(8e-4 / 2 * np.sqrt(4) / 1e-4, abs=3.5)
    after = discrepancies(diagnosis.extended, 1.0)
    assert max(abs(part.in_sd or 0.0) for part in after) < 4


def test_one_percent_of_a_right_model_lies_outside_the_envelope(diagnosis):
    shares = [np.mean(normal_quantiles(of_a_right_model(diagnosis, seed)).outside) for seed in range(40)]
    assert 0.002 < np.mean(shares) < 0.025
    plot = normal_quantiles(diagnosis.nominal)
    assert np.any(plot.outside) and np.all(plot.low < plot.middle) and np.all(plot.middle < plot.high)
    np.testing.assert_allclose(plot.normal, -plot.normal[::-1], atol=1e-12)


def test_quantiles_kept_of_a_check_are_those_of_its_distribution(diagnosis):
    """The sum of squares of known noise is chi-squared with the fit's degrees of freedom."""
    (check,) = [statistic for statistic in predictive(diagnosis.nominal) if statistic.name == "sum of squares"]
    np.testing.assert_allclose(check.quantiles, stats.chi2.ppf(QUANTILES, diagnosis.nominal.dof), rtol=0.03)
    assert check.low < check.quantiles[0] and check.quantiles[-1] < check.high and check.outside
