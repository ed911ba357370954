"""
A two-axis table
================

The inner axis of the table carries the triad, the outer one is horizontal. Its model is a function of the two angles; effects
of the catalogue on the first angle and on the sensor are the candidates of the diagnosis.
"""

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import tumblecal
from tumblecal import PositionSet
from tumblecal.chain import Unknown, forward_chain
from tumblecal.estimation import where_of


tumblecal.enable_float64()


def readings_of(p, where):
    """Bias and scale factors of a triad on an inner axis (alpha) that is square to the outer one (beta) but for `square`."""
    outer, inner = where.beta + p["outer_zero"], where.alpha
    # Gravity in the frame of the outer axis x, then of the inner axis z, tilted by `square` about y.
    across, along = jnp.sin(outer), jnp.cos(outer)
    tilted = jnp.sin(p["square"]) * along, across, jnp.cos(p["square"]) * along
    x = jnp.cos(inner) * tilted[0] + jnp.sin(inner) * tilted[1]
    y = -jnp.sin(inner) * tilted[0] + jnp.cos(inner) * tilted[1]
    inputs = dict(zip("xyz", (x, y, tilted[2]), strict=True))
    return tuple((1 + p[f"scale_{axis}"]) * u + p[f"bias_{axis}"] for axis, u in inputs.items())


unknowns = {"outer_zero": Unknown(unit="rad"), "square": Unknown(unit="rad")}
unknowns |= {f"scale_{axis}": Unknown() for axis in "xyz"} | {f"bias_{axis}": Unknown(unit="g") for axis in "xyz"}
chain = forward_chain(readings_of, unknowns)

# %%
# Simulated by plain numpy: the inner index has an error of 0.6 mrad cos(2 alpha), which the model does not know.
alpha, beta = np.tile(np.arange(12) * 30.0, 5), np.repeat([-80.0, -40.0, 10.0, 50.0, 90.0], 12)
a, b = np.radians(alpha), np.radians(beta)
a = a + 0.6e-3 * np.cos(2 * a)
plane = np.sin(b)[:, None] * np.column_stack([np.sin(a), np.cos(a)])
true = np.column_stack([plane, np.cos(b)]) * [1.001, 0.9995, 1.0] + [0.002, 0.0, -0.001]
measured = true + np.random.default_rng(2).normal(scale=1e-4, size=true.shape)
data = PositionSet.from_arrays(measured, alpha, beta, unit="deg", sd=1e-4)
assert np.allclose(np.asarray(chain(where_of(data))), true, atol=5e-3)  # two derivations of one table

# %%
diagnosis = tumblecal.diagnose(data, chain=chain)
print(diagnosis.verdict, diagnosis.labels)
print(
    dict(zip(diagnosis.extended.names[-2:], (1e3 * diagnosis.extended.values[-2:]).round(3).tolist(), strict=True)),
    "mrad",
)

# %%
figure = Figure(figsize=(6.4, 3.4), layout="constrained")
axes = figure.subplots()
axes.plot(alpha, 1e3 * diagnosis.nominal.residuals[:, 0], "o", color="0.5", label="model")
axes.plot(alpha, 1e3 * diagnosis.extended.residuals[:, 0], "o", color="tab:green", label="extended model")
axes.set_xlabel("inner axis / deg")
axes.set_ylabel("residual of x / mg")
axes.legend()
assert diagnosis.labels == ("index_ellipticity",)
