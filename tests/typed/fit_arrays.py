"""A user's script: arrays in, a fit, its derivatives."""

from dataclasses import replace

import jax
import numpy as np

import tumblecal
from tumblecal import Problem
from tumblecal.chain import nominal_chain, settings
from tumblecal.estimation import exact


tumblecal.enable_float64()
where = settings(np.tile(np.arange(8) * np.pi / 4, 3), np.repeat([0.0, 0.5, 1.0], 8))
chain = nominal_chain(where)
problem = Problem.from_arrays(chain, where, chain(where), noise_sd=1e-4)
fit = tumblecal.fit(problem)
low, high = fit.interval(0.95)[fit.names.index("bias_x")]
print(fit.message, fit.value("bias_x"), low, high, fit.table())


def estimate(readings: jax.Array) -> jax.Array:
    """The estimate by readings."""
    return exact.solve(replace(problem, readings=readings), chain.vector)[0]


print(estimate(chain(where)).shape, exact.sensitivity(problem, fit.values).shape)
