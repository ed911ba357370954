"""A user's script: many fits and simulated calibrations."""

import jax
import numpy as np

import tumblecal
from tumblecal.estimation import problem_of
from tumblecal.simulation import coverage, linearisation_error, monte_carlo, sweep


tumblecal.enable_float64()
data = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)
problem = problem_of(data, noise_sd=0.15e-3)
many = tumblecal.fit_many(problem, np.stack([data.readings] * 100))
print(many.values.shape, many.converged.mean(), many.sd.shape, many.table())


def truth(key: jax.Array) -> jax.Array:
    """Heavy tails."""
    return 1e-3 * jax.random.t(key, 4.0, (15,))


runs = monte_carlo(problem, 2048, seed=7, truth=truth)
print(
    runs.coverage(0.95).mean(),
    coverage(problem, 2048, truth=truth),
    sweep({"plan": problem}, 1024),
    linearisation_error(problem.chain, problem.where, [1e-3]),
)
