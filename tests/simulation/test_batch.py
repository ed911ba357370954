"""Batched fits against optimistix and the closed form."""

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

from tumblecal.chain import nominal_chain, settings
from tumblecal.chain.plan import grid
from tumblecal.data import PositionSet
from tumblecal.estimation import problem_of
from tumblecal.estimation.programs import compiler_options
from tumblecal.simulation.chain_fit import expansion, fit_chain
from tumblecal.simulation.experiment import BLOCK, experiment
from tumblecal.simulation.harmonic_fit import fit_harmonics
from tumblecal.simulation.inject import injected_links
from tumblecal.simulation.sums import sums_of
from tumblecal.simulation.uniform import harmonic_path


pytestmark = pytest.mark.usefixtures("quickly_compiled")

SD = 1.5e-4
LANES = 24


def quick(function):
    """Compiled without optimisation: what is compared here runs once."""
    return jax.jit(function, compiler_options=compiler_options())


def readings_of(chain, where, size, seed, lanes=LANES):
    generator = np.random.default_rng(seed)
    truth = generator.normal(size=(lanes, len(chain.vector))) * size
    exact = quick(jax.vmap(lambda vector: chain.at(vector)(where)))(jnp.asarray(truth))
    return truth, np.asarray(exact) + SD * generator.normal(size=exact.shape)


def by_optimistix(chain, where, readings):
    def one(measured):
        def residual(scaled, _):
            return ((chain.at(scaled * 1e-3)(where) - measured) / SD).ravel()

        solver = optx.GaussNewton(rtol=1e-12, atol=1e-12)
        solution = optx.least_squares(residual, solver, jnp.zeros(len(chain.vector)), throw=False, max_steps=50)
        return solution.value * 1e-3

    return np.asarray(quick(jax.vmap(one))(jnp.asarray(readings)))


def fitted(uniform, readings):
    fit = quick(lambda y: fit_harmonics(uniform.harmonics(y), uniform.pitch, uniform.angles))
    return fit(jnp.asarray(np.moveaxis(readings, 0, 2)))


def by_chain(problem, readings):
    shared = expansion(problem)
    return quick(lambda y: fit_chain(problem, shared, y))(jnp.asarray(readings))


def data_of(alpha_deg, beta_deg, readings):
    names = tuple(str(place) for place in range(len(alpha_deg)))
    return PositionSet(names, np.asarray(alpha_deg, float), np.asarray(beta_deg, float), readings)


def test_both_paths_and_optimistix_agree():
    plan = grid(np.arange(8) * 45.0, np.array([0.0, 45.0, 90.0]))
    where = settings(plan.alpha, plan.beta)
    chain = nominal_chain(where)
    _, readings = readings_of(chain, where, 3e-3, seed=2)
    problem = problem_of(data_of(plan.alpha_deg, plan.beta_deg, np.zeros((24, 3))), chain, noise_sd=SD)
    uniform = harmonic_path(problem)
    fast = fitted(uniform, readings)
    other = by_optimistix(chain, where, readings)
    good = np.arange(LANES) != 5
    general = by_chain(problem, np.where(good[:, None, None], readings, np.nan))
    np.testing.assert_allclose(fast.values.T, other, rtol=0, atol=1e-10)
    np.testing.assert_allclose(general.values[good], other[good], rtol=0, atol=1e-10)
    # A lane without readings neither delays nor changes the others.
    assert np.all(fast.converged) and np.array_equal(general.converged, good)


def paper_experiment(**options):
    plan = grid(np.arange(8) * 45.0, np.array([0.0, 45.0, 90.0]))
    where = settings(plan.alpha, plan.beta)
    chain = nominal_chain(where)
    chain = chain.at(np.linspace(-2e-3, 2e-3, 15))
    return experiment(chain, where, sd=SD, **options)


def test_a_lost_lane_is_counted_and_not_averaged_in():
    setup = paper_experiment()
    trials = quick(lambda block: setup.trials(0, block))(0)
    sums = quick(lambda t: sums_of(t, setup))
    whole = sums(trials)
    lost = trials._replace(converged=trials.converged.at[7].set(False), values=trials.values.at[:, 7].set(jnp.nan))
    rest = sums(lost)
    assert float(rest.failed) == 1 and float(rest.trials) == BLOCK
    one = (np.asarray(trials.values - trials.truth)[:, 7]) / np.sqrt(np.diag(setup.covariance))
    np.testing.assert_allclose(whole.error - rest.error, one, rtol=0, atol=1e-10)


def test_injected_effects_reach_both_paths_alike():
    plan = grid(np.arange(8) * 45.0, np.array([0.0, 45.0, 90.0]))
    (link,) = injected_links({"second_order.y": [0.5]}, settings(plan.alpha, plan.beta))
    fast, general = paper_experiment(injected=(link,)), paper_experiment(injected=(link,), path="chain")
    first, second = (quick(lambda b, e=e: e.trials(1, b))(2) for e in (fast, general))
    np.testing.assert_allclose(first.values, second.values, rtol=0, atol=1e-10)
    np.testing.assert_allclose(first.chi2, second.chi2, rtol=1e-7)
    assert float(jnp.mean(first.chi2)) > 60


def test_any_chain_noise_and_prior_far_from_the_reference_is_scipy_s_minimum():
    from scipy.optimize import least_squares

    from tumblecal import Problem
    from tumblecal.effects import catalogue

    generator = np.random.default_rng(8)
    where = settings(generator.uniform(0, 2 * np.pi, 28), np.repeat([0.0, 0.4, 0.9, 1.4], 7))
    chain = nominal_chain(where)
    for effect in ("second_order.y", "second_order.z"):
        chain = chain + catalogue()[effect].make(where)[0]
    truth, readings = readings_of(chain, where, 3e-2, seed=6, lanes=2)
    sd = generator.uniform(0.5, 2.0, (28, 3)) * SD
    problem = Problem.from_arrays(chain, where, np.zeros((28, 3)), noise_sd=sd, priors={"dbeta": (1e-2, 1e-2)}).bare
    fits = by_chain(problem, readings)
    model = quick(lambda vector: chain.at(vector)(where))
    stated = np.array([name.startswith("dbeta") for name in chain.names])

    def rows(scaled, measured):
        vector = 1e-2 * scaled
        return np.append((np.asarray(model(vector)) - measured) / sd, (vector[stated] - 1e-2) / 1e-2)

    for lane in range(2):
        tight = {"jac": "3-point", "xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15}
        other = least_squares(rows, 1e2 * truth[lane], args=(readings[lane],), **tight)
        assert fits.converged[lane]
        np.testing.assert_allclose(fits.values[lane], 1e-2 * other.x, rtol=0, atol=2e-10)
        assert fits.chi2[lane] == pytest.approx(2 * other.cost, rel=1e-9)
