"""A problem and its variants, in closed forms; its exact fit under correlated noise against plain least squares."""

from dataclasses import replace
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from rigs import PAPER_ALPHA, PAPER_BETA, measured, positions, random_vector, setting

import independent
from tumblecal.chain import Link, Parameter, Place, State, Where, coefficients
from tumblecal.estimation import exact, problem_of
from tumblecal.noise.covariance import Covariance


class Offset(Link):
    """A shift of the output of y that grows with the number of the position."""

    place: ClassVar[Place] = Place.READING
    size: Parameter

    def __call__(self, state: State, where: Where) -> State:
        """The shifted output."""
        (size,) = self.size.at(where)
        x, y, z = state.reading
        return State(state.alpha, state.beta, state.f, (x, y + size * jnp.arange(24.0), z))


@pytest.fixture(scope="module")
def problem():
    data = measured(random_vector(4, spread=2e-3), sd=2e-4, seed=9)
    return problem_of(data, noise_sd=2e-4, priors={"dbeta": (1e-3, 5e-4), "gamma_21": (0.0, 1e-4)})


def full_covariance(seed: int, count: int = 72) -> np.ndarray:
    """Neighbouring positions alike, axes of different noise, g^2."""
    sd = np.random.default_rng(seed).uniform(1e-4, 4e-4, count)
    position = np.arange(count // 3)
    return np.outer(sd, sd) * np.kron(0.6 ** np.abs(position[:, None] - position), 0.3 + 0.7 * np.eye(3))


def test_added_links_have_no_prior_and_leave_the_others_theirs(problem):
    extended = problem.with_links(Offset(coefficients("offset", ("y",), unit="g")))
    assert set(extended.chain.names) - set(problem.chain.names) == {"offset_y"}
    before = dict(zip(problem.chain.names, zip(problem.prior_mean, problem.prior_weights, strict=True), strict=True))
    for name, mean, weight in zip(extended.chain.names, extended.prior_mean, extended.prior_weights, strict=True):
        assert (mean, weight) == before.get(name, (0.0, 0.0))
    assert before["dbeta_1"] == (1e-3, 1 / 5e-4) and extended.priors == problem.priors == 4
    # One milligravity a position, and nothing else: the prediction says so.
    vector = jnp.where(np.array(extended.chain.names) == "offset_y", 1e-3, 0.0)
    shift = np.asarray(extended.predicted(vector)) - np.asarray(problem.predicted(jnp.zeros(15)))
    np.testing.assert_allclose(shift, np.outer(np.arange(24), [0, 1e-3, 0]), rtol=0, atol=1e-16)
    np.testing.assert_array_equal(extended.residual(vector)[72:], _prior_rows(extended, vector))
    assert problem.with_links().chain.names == problem.chain.names


def _prior_rows(problem, vector):
    return (vector - problem.prior_mean) * problem.prior_weights


def test_positions_left_out_add_up_and_leave_the_problem_as_it_was(problem):
    fewer = problem.without((2, 5)).without((7,))
    assert np.flatnonzero(~fewer.takes_part).tolist() == [2, 5, 7]
    assert problem.retained is None and problem.takes_part.all() and len(problem.takes_part) == 24
    assert fewer.readings is problem.readings and fewer.noise is problem.noise


def test_exact_fit_under_a_full_covariance_is_generalised_least_squares():
    """Gauss-Newton in plain numpy: (J' K^-1 J)^-1 J' K^-1 (y - f), its derivatives by differences."""
    covariance = full_covariance(5)
    noise = np.linalg.cholesky(covariance) @ np.random.default_rng(6).normal(size=72)
    truth = random_vector(12, spread=5e-3)
    clean = measured(truth)
    data = positions(PAPER_ALPHA, PAPER_BETA, clean.readings + noise.reshape(24, 3))
    fit = exact.fit(problem_of(data).with_noise(Covariance(covariance, "full"), known=True))

    def predicted(vector):
        return independent.nominal(vector, data.alpha, data.beta, setting(PAPER_BETA)).ravel()

    vector, precision, step = np.zeros(15), np.linalg.inv(covariance), 1e-5
    for _ in range(8):
        slopes = [
            (predicted(vector + step * unit) - predicted(vector - step * unit)) / (2 * step) for unit in np.eye(15)
        ]
        jacobian = np.stack(slopes, axis=1)
        normal = jacobian.T @ precision @ jacobian
        vector = vector + np.linalg.solve(normal, jacobian.T @ precision @ (data.readings.ravel() - predicted(vector)))
    left = data.readings.ravel() - predicted(vector)
    assert fit.code.good and fit.noise == "stated"
    np.testing.assert_allclose(fit.values, vector, rtol=0, atol=1e-9)
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(normal), rtol=1e-5, atol=1e-14)
    np.testing.assert_allclose(fit.residuals.ravel(), left, rtol=0, atol=1e-9)
    assert fit.chi2 == pytest.approx(left @ precision @ left, rel=1e-7)
    # The covariance matters: with its diagonal alone the estimate is another.
    diagonal = exact.fit(problem_of(replace(data, sd=np.sqrt(np.diag(covariance)).reshape(24, 3))))
    assert np.max(np.abs(diagonal.values - fit.values) / fit.sd) > 0.3


def test_positions_left_out_take_no_part_in_the_exact_fit():
    """The same as without them, and what is said of them is how far they are from the fit to the others."""
    data = measured(random_vector(3, spread=3e-3), sd=2e-4, seed=1)
    data.readings[7] += [0.02, -0.01, 0.03]
    others = [position for position in range(24) if position != 7]
    for options in ({"noise_sd": 2e-4}, {}):
        fit, fewer = (
            exact.fit(problem_of(data, **options).without((7,))),
            exact.fit(problem_of(data.chosen(others), **options)),
        )
        assert fit.dof == fewer.dof == 69 - 15 and not fit.retained[7]
        np.testing.assert_allclose(fit.values, fewer.values, rtol=0, atol=1e-12)
        np.testing.assert_allclose(fit.covariance, fewer.covariance, rtol=1e-7)
        np.testing.assert_allclose([fit.chi2, fit.sigma, fit.rms], [fewer.chi2, fewer.sigma, fewer.rms], rtol=1e-9)
        np.testing.assert_allclose(fit.residuals[others], fewer.residuals, rtol=0, atol=1e-12)
        expected = independent.nominal(fewer.values, data.alpha, data.beta, setting(PAPER_BETA))
        np.testing.assert_allclose(fit.residuals[7], (data.readings - expected)[7], rtol=0, atol=1e-12)
