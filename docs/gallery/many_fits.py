"""
A thousand calibrations at once
===============================

`jax.vmap` repeats the exact fit for a thousand draws of the noise. The spread of the estimates agrees with the
stated uncertainty.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import tumblecal
from tumblecal.estimation import exact, problem_of


tumblecal.enable_float64()

positions = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)
problem = problem_of(positions, noise_sd=0.15e-3)
fit = exact.fit(problem)

start = jnp.asarray(fit.vector)
noise = 0.15e-3 * jax.random.normal(jax.random.key(0), (1000, *positions.readings.shape))


def estimate(readings):
    """One exact fit: a pure function of the readings, shape (positions, 3)."""
    return exact.solve(replace(problem, readings=readings), start)[0]


estimates = jax.jit(jax.vmap(estimate))(positions.readings + noise)  # (1000, parameters)

# %%
number = fit.names.index("dK_y")
figure = Figure(figsize=(6.4, 3.4), layout="constrained")
axes = figure.subplots()
axes.hist(1e3 * np.asarray(estimates[:, number]), 40, density=True, color="0.7", label="1000 draws of the noise")
grid = 1e3 * (fit.values[number] + fit.sd[number] * np.linspace(-4, 4, 200))
width = 1e3 * fit.sd[number]
density = np.exp(-(((grid - 1e3 * fit.values[number]) / width) ** 2) / 2) / (width * np.sqrt(2 * np.pi))
axes.plot(grid, density, label="stated uncertainty")
axes.set_xlabel("dK_y / 1e-3")
axes.legend()
