"""A user's script: other solvers and losses."""

import jax
import jax.numpy as jnp
import optimistix as optx

import tumblecal
from tumblecal.estimation import problem_of
from tumblecal.estimation.robust import Loss, cauchy, huber


tumblecal.enable_float64()
problem = problem_of(tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1), noise_sd=0.15e-3)


def mine(residual: jax.Array) -> jax.Array:
    """A loss."""
    return jnp.sqrt(1.0 + residual**2) - 1.0


for loss in (huber(), cauchy(2.0), Loss("pseudo-Huber", mine)):
    fit = tumblecal.fit(problem, loss=loss)
    print(fit.method, fit.sd.max(), fit.statistics["steps"])
print(tumblecal.fit(problem, solver=optx.LevenbergMarquardt(1e-10, 1e-10)).code.good)
