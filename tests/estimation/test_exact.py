"""The exact fit: against scipy on an independent chain, from hard starts, with priors; its derivative."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rigs import PAPER_BETA, measured, random_vector, setting

import independent
from tumblecal.estimation import Code, closed_form, exact, problem_of
from tumblecal.estimation.linearised import linearised


SEEDS = st.integers(0, 2**32 - 1)


@given(SEEDS)
def test_equals_scipy_and_the_closed_form_on_random_rigs(seed):
    """Random instrument up to 5 degrees, random angles at three pitch settings, noise of 0.1 mg."""
    rng = np.random.default_rng(seed)
    alpha = np.concatenate([np.arange(8) * 45 + rng.uniform(-15, 15, 8) for _ in range(3)])
    beta = np.repeat(np.array([0, 45, 90]) + rng.uniform(-10, 10, 3), 8)
    data = measured(random_vector(seed), alpha, beta, sd=1e-4, seed=seed + 1)
    ours = exact.fit(problem_of(data))
    theirs, covariance = independent.scipy_fit(data.readings, data.alpha, data.beta, setting(beta))
    assert ours.code.good
    np.testing.assert_allclose(ours.values, theirs, rtol=0, atol=1e-10)
    np.testing.assert_allclose(closed_form.estimate(data), ours.values, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ours.covariance, covariance * ours.sigma**2, rtol=1e-5, atol=1e-16)
    np.testing.assert_allclose(
        ours.residuals, data.readings - independent.nominal(theirs, data.alpha, data.beta, setting(beta)), atol=1e-10
    )


def test_a_mounting_far_from_nominal_converges_and_says_how():
    """Turned by 100, -50 and 140 degrees: the nominal start is useless, the closed form is not."""
    truth = random_vector(3)
    truth[6:9] = np.radians([100, -50, 140])
    data = measured(truth, sd=1e-4)
    result = exact.fit(problem_of(data))
    assert result.code in (Code.CONVERGED_BY_FALLBACK, Code.CONVERGED_FROM_CLOSED_FORM, Code.CONVERGED)
    predicted = independent.nominal(result.values, data.alpha, data.beta, setting(PAPER_BETA))
    # It fits as well as the truth does: the sum of squares is that of noise, not of a local minimum.
    assert np.sqrt(np.mean((data.readings - predicted) ** 2)) < 1.2e-4
    np.testing.assert_allclose(result.residuals, data.readings - predicted, atol=1e-12)


def test_a_hopeless_start_never_gives_a_good_code_with_bad_values(table1, table1_fit):
    problem = problem_of(table1)
    for seed in range(6):
        start = np.random.default_rng(seed).uniform(-3, 3, 15)
        result = exact.fit(problem, start=start)
        if result.code.good:
            # Other signs and turns of the angles may describe the same instrument; the residuals may not differ.
            np.testing.assert_allclose(result.sigma, table1_fit.sigma, rtol=1e-9)


def test_weights_come_from_sd_columns():
    """An axis with a ten times larger sd counts a hundred times less: scipy with the same weights."""
    sd = np.tile([1e-4, 1e-3, 2e-4], (24, 1)) * np.linspace(0.5, 2, 24)[:, None]
    data = replace(measured(random_vector(11), sd=5e-4, seed=5), sd=sd)
    result = exact.fit(problem_of(data))

    def residual(scaled):
        return (
            (independent.nominal(scaled * 1e-3, data.alpha, data.beta, setting(PAPER_BETA)) - data.readings) / sd
        ).ravel()

    theirs, _ = independent.least(residual, np.zeros(15))
    np.testing.assert_allclose(result.values, theirs * 1e-3, rtol=0, atol=1e-10)
    unweighted = exact.fit(problem_of(replace(data, sd=None)))
    assert np.max(np.abs(unweighted.values - result.values)) > 1e-5
    assert result.noise == "stated" and unweighted.noise == "estimated"
    assert result.chi2 == pytest.approx(float(np.sum(residual(theirs) ** 2)), rel=1e-9)


def test_a_prior_is_one_more_observation():
    """A prior on dbeta: scipy with three more rows."""
    truth = random_vector(21, spread=2e-3)
    data = measured(truth, sd=2e-4, seed=2)
    result = exact.fit(problem_of(data, noise_sd=2e-4, priors={"dbeta": (1e-3, 5e-4), "gamma_21": (0.0, 1e-4)}))

    def residual(scaled):
        v = scaled * 1e-3
        rows = (independent.nominal(v, data.alpha, data.beta, setting(PAPER_BETA)) - data.readings) / 2e-4
        return np.concatenate([rows.ravel(), (v[12:] - 1e-3) / 5e-4, [v[9] / 1e-4]])

    theirs, covariance = independent.least(residual, np.zeros(15))
    np.testing.assert_allclose(result.values, theirs * 1e-3, rtol=0, atol=1e-10)
    np.testing.assert_allclose(result.covariance, covariance * 1e-6, rtol=1e-6, atol=1e-18)
    assert result.chi2 == pytest.approx(float(np.sum(residual(theirs) ** 2)), rel=1e-9)
    assert result.dof == 72 + 4 - 15


def test_derivative_by_the_data_is_that_of_refits():
    """Large residuals (30 mg) and angles, so that the residuals' curvature matters and J's pseudo-inverse is wrong."""
    data = measured(random_vector(17), sd=0.03, seed=8)
    problem = problem_of(data, noise_sd=0.03)
    result = exact.fit(problem)
    ours = np.asarray(exact.sensitivity(problem, result.values))
    assert ours.shape == (15, 24, 3)
    chosen = [(0, 2), (5, 0), (11, 1), (23, 0)]
    step = 1e-5
    for position, axis in chosen:
        ends = []
        for sign in (1, -1):
            moved = data.readings.copy()
            moved[position, axis] += sign * step
            ends.append(exact.fit(problem_of(replace(data, readings=moved), noise_sd=0.03), result.values).values)
        np.testing.assert_allclose(ours[:, position, axis], (ends[0] - ends[1]) / (2 * step), rtol=0, atol=2e-6)
    jacobian = np.asarray(linearised(problem, result.values)[1])
    first_order = (np.linalg.pinv(jacobian) * problem.scales[:, None] / 0.03).reshape(15, 24, 3)
    assert np.max(np.abs(first_order - ours)) > 1e-3  # what the test would not see without curvature


def test_not_finite_data_are_reported_by_name(table1):
    broken = replace(table1, readings=np.where(np.eye(24, 3) > 0, 1e308, table1.readings))
    result = exact.fit(problem_of(broken))
    assert not result.code.good
    assert "not converged" in result.message


def test_priors_take_the_degrees_of_freedom_of_what_they_determine(table1):
    """`sigma`: with nearly exact priors that of the fit with these parameters fixed, with hardly any that without them."""
    problem = problem_of(table1)
    fixed = exact.fit(problem_of(table1, problem.chain.fixed({"dbeta"})))
    for sd, expected in ((1e-9, fixed.sigma), (1e3, exact.fit(problem).sigma)):
        found = exact.fit(problem_of(table1, noise_sd=1e-4, priors={"dbeta": (0.0, sd)}))
        assert found.sigma == pytest.approx(expected, rel=1e-4)
