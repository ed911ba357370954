"""Problems and position sets from arrays, as pytrees, and the density of a problem."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

import tumblecal
from tumblecal import InputError, PositionSet, Problem
from tumblecal.chain import nominal_chain, settings
from tumblecal.estimation import exact
from tumblecal.noise import Covariance


SD = 1e-4  # g


@pytest.fixture(scope="module")
def plan():
    where = settings(np.tile(np.arange(8) * np.pi / 4, 3), np.repeat([0.0, 0.5, 1.0], 8))
    chain = nominal_chain(where)
    readings = np.asarray(chain.named({"bias_x": 1e-3, "dK_y": 5e-4})(where))
    return chain, where, readings + np.random.default_rng(0).normal(scale=SD, size=(24, 3))


@pytest.fixture(scope="module")
def problem(plan):
    return Problem.from_arrays(*plan, noise_sd=SD)


@pytest.mark.parametrize("form", [np.asarray, jnp.asarray, lambda values: values.tolist()])
def test_lists_numpy_and_jax_arrays_give_the_fit_of_the_position_set(plan, form):
    chain, where, readings = plan
    data = PositionSet.from_arrays(form(readings), form(where.alpha), form(where.beta), unit="rad", sd=SD)
    expected = tumblecal.calibrate(data).exact
    fit = tumblecal.fit(Problem.from_arrays(chain, where, form(readings), noise_sd=SD))
    assert np.allclose(fit.values, expected.values, rtol=0, atol=1e-12)
    assert np.allclose(fit.covariance, expected.covariance, rtol=1e-9, atol=0)
    assert fit.data.names == data.names == tuple(str(number) for number in range(1, 25))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"readings": np.zeros((23, 3))}, r"readings have the shape \(23, 3\); 24 positions need \(24, 3\)"),
        ({"noise_sd": 0.0}, "noise_sd must be above 0"),
        ({"noise_sd": np.full(24, SD)}, r"noise_sd has the shape \(24,\); give one number, .* \(24, 1\)"),
        ({"readings": [["a", "b", "c"]] * 24}, "readings: give numbers in g"),
        ({"readings": np.full((24, 3), 5.7)}, r"median norm is 9\.873, but 1 g at rest; they look like m/s\^2: divide"),
        ({"noise_sd": SD, "noise": Covariance.of_sd(np.ones((24, 3)))}, "give only one of them"),
        ({"priors": {"dbeta": (0.0, 1e-3)}}, "a prior needs a stated noise"),
        ({"noise_sd": SD, "priors": {"dbta": (0.0, 1e-3)}}, "no such parameter"),
    ],
)
def test_wrong_arrays_are_one_message(plan, change, words):
    chain, where, readings = plan
    with pytest.raises(InputError, match=words):
        Problem.from_arrays(chain, where, **({"readings": readings} | change))


def test_a_problem_is_traced_through_and_keeps_what_it_holds(plan, problem):
    chain, where, readings = plan
    by_arrays = jax.jit(
        lambda values: exact.solve(Problem.from_arrays(chain, where, values, noise_sd=SD), jnp.zeros(15))[0]
    )
    fit = tumblecal.fit(problem)
    assert np.allclose(by_arrays(readings), fit.values, atol=1e-12)
    for same in (jax.tree.map(lambda leaf: leaf, problem), jax.jit(lambda tree: tree)(problem)):
        assert same.data is problem.data and same.noise is problem.noise and repr(same) == repr(problem)
        assert np.allclose(tumblecal.fit(same).values, fit.values, atol=1e-12)
    again = jax.jit(lambda tree: tree)(fit)
    assert again.names == fit.names and again.message == fit.message and np.array_equal(again.sd, fit.sd)
    doubled = jax.tree.map(lambda leaf: 2 * leaf, problem.data)
    assert doubled.names == problem.names and np.array_equal(doubled.readings, 2 * readings)


@pytest.mark.parametrize("log_noise", [None, 0.3])
def test_log_density_is_likelihood_times_priors(plan, log_noise):
    chain, where, readings = plan
    problem = Problem.from_arrays(chain, where, readings, noise_sd=SD, priors={"dbeta": (1e-3, 2e-3)})
    vector = 1e-4 * np.arange(15)
    deviation = np.asarray(chain.at(vector)(where)) - readings
    expected = norm.logpdf(deviation, scale=SD * np.exp(log_noise or 0.0)).sum()
    expected += norm.logpdf(vector[-3:], loc=1e-3, scale=2e-3).sum()
    assert float(problem.log_density(vector, log_noise)) == pytest.approx(expected)


def test_log_density_under_correlated_noise_is_that_of_the_covariance(plan):
    chain, where, readings = plan
    between = SD**2 * 0.8 ** np.abs(np.subtract.outer(np.arange(24), np.arange(24)))
    problem = Problem.from_arrays(chain, where, readings, noise=Covariance.by_axis(np.stack([between] * 3)))
    deviation = np.asarray(chain(where)) - readings
    expected = sum(multivariate_normal.logpdf(deviation[:, axis], cov=between) for axis in range(3))
    assert float(problem.log_density(chain.vector)) == pytest.approx(expected)


def test_the_fit_is_the_maximum_of_the_density(problem):
    best = tumblecal.fit(problem)
    slope = jax.grad(problem.log_density)(jnp.asarray(best.values))
    assert np.max(np.abs(slope * best.sd)) < 1e-5
