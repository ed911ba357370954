"""Do 95 % intervals hold the truth 95 times in 100? Statistics, with tolerances from the binomial distribution."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from rigs import measured, random_vector
from scipy import stats

from tumblecal.estimation import exact, problem_of
from tumblecal.estimation.linearised import linearised


pytestmark = pytest.mark.usefixtures("quickly_compiled")
SETS = 2000
# 15 parameters are looked at: 4.5 binomial standard deviations are passed by chance once in 10000 runs of this file.
MOST_SD = 4.5


def check_coverage(inside: np.ndarray, level: float) -> None:
    """`inside` (sets, parameters): whether the interval held the truth."""
    expected_sd = np.sqrt(level * (1 - level) / len(inside))
    off = (inside.mean(axis=0) - level) / expected_sd
    assert np.max(np.abs(off)) < MOST_SD, f"coverage {inside.mean(axis=0).round(4)}"


def test_stated_noise_intervals_and_chi2():
    """2000 calibrations at angles up to 5 degrees in one batch; each with its own covariance; normal intervals."""
    truth, sd = random_vector(5), 2e-4
    clean = measured(truth)
    problem = problem_of(clean, noise_sd=sd)
    noise = np.random.default_rng(2024).normal(size=(SETS, 24, 3)) * sd

    def calibrate(readings):
        here = replace(problem, readings=readings)
        vector, converged, _ = exact.solve(here, jnp.asarray(problem.chain.vector))
        residual, jacobian = linearised(here, vector)
        return vector, converged, residual @ residual, jnp.linalg.inv(jacobian.T @ jacobian)

    vectors, converged, chi2, inverse = map(np.asarray, jax.jit(jax.vmap(calibrate))(clean.readings + noise))
    assert converged.all()
    deviations = np.sqrt(np.diagonal(inverse, axis1=1, axis2=2)) * problem.scales
    for level in (0.5, 0.95):
        half = stats.norm.ppf(0.5 + level / 2) * deviations
        check_coverage(np.abs(vectors - truth) < half, level)
    dof = 72 - 15
    assert stats.kstest(chi2, stats.chi2(dof).cdf).pvalue > 1e-3
    assert np.mean(chi2) / dof == pytest.approx(1.0, abs=4 * np.sqrt(2 / dof / SETS))
    # The estimates' scatter is the covariance, in all directions at once: squared lengths are chi-square of 15.
    lengths = np.einsum(
        "si,sij,sj->s", (vectors - truth) / problem.scales, np.linalg.inv(inverse), (vectors - truth) / problem.scales
    )
    assert stats.kstest(lengths, stats.chi2(15).cdf).pvalue > 1e-3


def test_estimated_noise_intervals_use_students_t():
    """7 positions, 6 degrees of freedom: the normal quantile would hold the truth only 90 times in 100."""
    alpha, beta = [0.0, 120.0, 240.0, 30.0, 200.0, 90.0, 310.0], [0.0, 0.0, 0.0, 45.0, 45.0, 90.0, 90.0]
    truth = random_vector(6, spread=3e-3)
    inside, normal = [], []
    for seed in range(300):
        data = measured(truth, alpha, beta, sd=2e-4, seed=seed)
        result = exact.fit(problem_of(data))
        low, high = result.interval(0.95).T
        inside.append((low < truth) & (truth < high))
        normal.append(np.abs(result.values - truth) < 1.96 * result.sd)
    assert result.dof == 6 and result.noise == "estimated"
    check_coverage(np.array(inside), 0.95)
    assert np.mean(normal) < 0.92


def test_interval_quantiles(table1_fit):
    """Half widths in units of sd: Student's t on 57 degrees of freedom here, normal with stated noise."""
    half = (table1_fit.interval(0.95)[:, 1] - table1_fit.values) / table1_fit.sd
    np.testing.assert_allclose(half, stats.t.ppf(0.975, 57), rtol=1e-9)
    stated = exact.fit(problem_of(table1_fit.data, noise_sd=1e-4))
    half = (stated.interval(0.9)[:, 1] - stated.values) / stated.sd
    np.testing.assert_allclose(half, stats.norm.ppf(0.95), rtol=1e-6)
    assert stated.chi2_p_value == pytest.approx(stats.chi2.sf(stated.chi2, 57), rel=1e-9)
    assert table1_fit.chi2_p_value is None
