"""The linear Kalman filter and the iterated one against batch formulas and the exact fit."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rigs import measured, random_vector
from scipy import stats

from tumblecal.effects import catalogue
from tumblecal.estimation import default_chain, exact, harmonic, iterated, kalman, problem_of, where_of
from tumblecal.estimation.kalman import DIFFUSE, Prior
from tumblecal.estimation.linearised import linearised


NOISE = 1.5e-4


@pytest.fixture(scope="module")
def sets():
    """200 data sets of harmonics of the linear model itself, with their H and R; and the true parameters."""
    harmonics = harmonic.analyse(problem_of(measured(np.zeros(15))))
    noise = harmonics.covariance * NOISE**2
    truth = random_vector(1, 15, 2e-3)
    rng = np.random.default_rng(7)
    z = harmonics.design @ truth + rng.multivariate_normal(np.zeros(27), noise, 200)
    return z, harmonics.design, noise, truth


def batch(z, design, noise, prior):
    """Posterior mean and covariance of a constant state by the information formula."""
    weight = np.linalg.inv(noise)
    information = np.eye(15) / prior.sd**2 + len(z) * design.T @ weight @ design
    return np.linalg.solve(information, design.T @ weight @ z.sum(axis=0)), np.linalg.inv(information)


@pytest.mark.parametrize("prior", [Prior(3e-4), Prior(1e-2), DIFFUSE])
def test_filter_is_the_batch_posterior(sets, prior):
    z, design, noise, _ = sets
    history, covariance = kalman.run(z, design, noise, prior)
    for step in (1, 7, 200):
        mean, spread = batch(z[:step], design, noise, prior)
        sd = np.sqrt(np.diag(spread))
        np.testing.assert_allclose((history.values[step - 1] - mean) / sd, 0, atol=1e-4)
        np.testing.assert_allclose(history.sd[step - 1], sd, rtol=1e-4)
    np.testing.assert_allclose(covariance / np.outer(sd, sd), spread / np.outer(sd, sd), atol=1e-4)


def test_a_diffuse_prior_gives_the_running_mean_of_least_squares(sets):
    z, design, noise, _ = sets
    history, _ = kalman.run(z, design, noise, DIFFUSE)
    root = np.linalg.inv(np.linalg.cholesky(noise))
    single = np.array([np.linalg.lstsq(root @ design, root @ row, rcond=None)[0] for row in z])
    mean = np.cumsum(single, axis=0) / np.arange(1, 201)[:, None]
    sd = np.sqrt(np.diag(np.linalg.inv(design.T @ np.linalg.inv(noise) @ design)))
    assert np.max(np.abs(history.values - mean) / sd) < 1e-4
    informed, _ = kalman.run(z, design, noise, Prior(3e-4))
    assert np.max(np.abs(informed.values - mean) / sd) > 0.5  # and an informative one does not


def test_joseph_covariance_stays_symmetric_and_positive(sets):
    """Through steps whose noise is 1e-6 of the prior, where the short form loses positivity."""
    z, design, noise, _ = sets
    mean, covariance = np.zeros(15), DIFFUSE.covariance(15)
    before = np.inf
    for row in z[:50]:
        mean, covariance, _ = kalman.update(mean, covariance, row, design, noise)
        assert np.array_equal(covariance, covariance.T)
        eigenvalues = np.linalg.eigvalsh(covariance)
        assert eigenvalues.min() > 0
        assert np.trace(covariance) < before
        before = np.trace(covariance)


def test_innovations_are_consistent(sets):
    """Normalised innovations squared are chi-square of 27 when the prior is the truth's own distribution."""
    z, design, noise, truth = sets
    history, _ = kalman.run(z - design @ truth, design, noise, Prior(1e-7))
    assert history.nis_dof == 27
    assert stats.kstest(history.nis, stats.chi2(27).cdf).pvalue > 1e-3


def test_a_run_is_a_step(table1):
    """Two runs of one data set each: the estimate is the two steps of the batch formula with run-wise dbeta."""
    data = replace(table1.chosen(np.tile(np.arange(24), 2)), run=("1",) * 24 + ("2",) * 24)
    result = kalman.fit(problem_of(data), sigma=1e-4, prior=DIFFUSE)
    assert len(result.history.values) == 2
    harmonics = harmonic.fit(problem_of(data, noise_sd=1e-4))
    assert result.names == harmonics.names
    sd = harmonics.sd
    np.testing.assert_allclose((result.values - harmonics.values) / sd, 0, atol=1e-4)


@settings(max_examples=4)
@given(st.integers(0, 2**32 - 1))
def test_iterated_filter_agrees_with_the_exact_fit_under_the_same_prior(seed):
    """Errors and prior of 2 mrad; the most probable estimate is the exact fit with the prior as observations."""
    data = measured(random_vector(seed, 15, 2e-3), sd=1e-4, seed=seed)
    prior = Prior(2e-3)
    problem = problem_of(data, noise_sd=1e-4)
    priors = dict.fromkeys(problem.chain.names, (0.0, prior.sd))
    most_probable = exact.fit(problem_of(data, noise_sd=1e-4, priors=priors))
    result = iterated.fit(problem, sigma=1e-4, prior=prior)
    assert np.max(np.abs(result.values - most_probable.values) / most_probable.sd) < 0.05
    np.testing.assert_allclose(result.sd, most_probable.sd, rtol=0.02)
    np.testing.assert_allclose(result.covariance, result.covariance.T, rtol=0, atol=0)
    assert np.linalg.eigvalsh(result.correlation).min() > 0
    assert len(result.history.values) == 24


@pytest.mark.parametrize("seed", [1, 2])
def test_iterated_filter_does_not_keep_what_the_first_positions_were_linearised_at(seed):
    """80 positions of 0.02 mg: the filter alone ended more than an sd from the exact fit under the same prior."""
    alpha, beta = np.tile(np.arange(16) * 22.5, 5), np.repeat(np.linspace(0, 90, 5), 16)
    data, prior = measured(random_vector(seed, 17, 8e-3), alpha, beta, sd=2e-5, seed=seed), Prior(0.01)
    problem = problem_of(data, noise_sd=2e-5)
    priors = dict.fromkeys(problem.chain.names, (0.0, prior.sd))
    most_probable = exact.fit(problem_of(data, noise_sd=2e-5, priors=priors))
    result = iterated.fit(problem, sigma=2e-5, prior=prior)
    alone = result.history.values[-1]
    assert np.max(np.abs(alone - most_probable.values) / most_probable.sd) > 1
    np.testing.assert_allclose((result.values - most_probable.values) / most_probable.sd, 0, atol=0.01)
    np.testing.assert_allclose(result.sd, most_probable.sd, rtol=1e-3)


def test_compiled_filter_is_the_one_by_one_filter():
    """With a drift in the chain, which counts from the first position in time, not the first row."""
    data = measured(random_vector(2, 15, np.radians(1)), sd=1e-4, seed=3)
    data = replace(data, time_s=60.0 * np.roll(np.arange(24.0), 5))
    chain = default_chain(data) + catalogue()["bias_drift.x"].make(where_of(data))[0]
    problem, prior = problem_of(data, chain, noise_sd=1e-4), Prior(0.02)
    result = iterated.fit(problem, sigma=1e-4, prior=prior)
    running = iterated.Filter(problem, prior)
    for position in range(24):
        nis = running.take(position, data.readings[position], np.full(3, 1e-4))
        sd = np.sqrt(np.diag(running.covariance))
        np.testing.assert_allclose((result.history.values[position] - running.mean) / sd, 0, atol=1e-6)
        np.testing.assert_allclose(result.history.sd[position], sd, rtol=1e-6)
        np.testing.assert_allclose(result.history.nis[position], nis, rtol=1e-6)


def test_the_filter_linearises_a_position_at_its_own_step_alone(monkeypatch):
    """Work that is linear in the rows: the whole set is linearised twice, where the filter ended and for the residuals."""
    calls = []
    monkeypatch.setattr(iterated, "linearised", lambda *arguments: calls.append(1) or linearised(*arguments))
    data = measured(random_vector(2, 15, 2e-3), sd=1e-4, seed=3)
    result = iterated.fit(problem_of(data, noise_sd=1e-4), sigma=1e-4)
    assert len(calls) == 2 and len(result.history.values) == 24


def test_positions_may_come_in_any_order():
    data = measured(random_vector(2, 15, 2e-3), sd=1e-4, seed=3)
    problem = problem_of(data, noise_sd=1e-4)
    ends = []
    for order in (range(24), np.random.default_rng(1).permutation(24)):
        running = iterated.Filter(problem, Prior(2e-3))
        for position in order:
            running.take(int(position), data.readings[position], np.full(3, 1e-4))
        ends.append(running)
    assert np.max(np.abs(ends[0].mean - ends[1].mean) / np.sqrt(np.diag(ends[0].covariance))) < 0.05
