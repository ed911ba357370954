"""A user's script: the density and its gradient."""

import jax
import numpy as np

import tumblecal
from tumblecal.estimation import problem_of


tumblecal.enable_float64()
problem = problem_of(tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1), noise_sd=0.15e-3)
best = tumblecal.fit(problem).values


def log_density(vector: jax.Array | np.ndarray[tuple[int], np.dtype[np.float64]]) -> jax.Array:
    """Of the parameters."""
    return problem.log_density(vector, log_noise=0.1)


print(float(log_density(best)))
