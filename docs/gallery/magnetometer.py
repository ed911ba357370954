"""
A magnetometer in the Earth's field
===================================

The model of a calibration need not be gravity on a dividing head. Here a triad of magnetometers is turned about two axes in
the Earth's field; the model is a function of its parameters and the angles. Readings are in units of the field.
"""

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import tumblecal
import tumblecal.estimation
from tumblecal import PositionSet
from tumblecal.chain import Unknown, forward_chain


tumblecal.enable_float64()
DIP = np.radians(64.0)  # inclination of the field


def readings_of(p, where):
    """Scale, hard iron and soft iron of a triad that is turned by alpha about x and by beta about y."""
    north, down = jnp.cos(DIP + p["dip"]), jnp.sin(DIP + p["dip"])
    a, b = where.alpha, where.beta
    x = jnp.cos(b) * north - jnp.sin(b) * down
    along = jnp.sin(b) * north + jnp.cos(b) * down
    y, z = jnp.sin(a) * along, jnp.cos(a) * along
    return (
        (1 + p["scale_x"]) * x + p["iron_x"],
        (1 + p["scale_y"]) * y + p["soft_yx"] * x + p["iron_y"],
        (1 + p["scale_z"]) * z + p["soft_zx"] * x + p["soft_zy"] * y + p["iron_z"],
    )


unknowns = {f"{kind}_{axis}": Unknown(scale=1e-2) for kind in ("scale", "iron") for axis in "xyz"}
unknowns |= {name: Unknown(scale=1e-2) for name in ("soft_yx", "soft_zx", "soft_zy")} | {
    "dip": Unknown(0.0, "rad", 1e-3)
}
chain = forward_chain(readings_of, unknowns)

# %%
# A simulated instrument whose z axis is not linear, which the model does not know. 3e-4 is the noise.
alpha, beta = np.tile(np.arange(8) * 45.0, 5), np.repeat([-70.0, -35.0, 0.0, 35.0, 70.0], 8)
rng, truth = np.random.default_rng(1), chain.named({"scale_x": 0.02, "iron_y": -0.05, "soft_zx": 0.01, "dip": 0.004})
blank = PositionSet.from_arrays(np.zeros((40, 3)), alpha, beta, unit="deg")
where = tumblecal.estimation.where_of(blank)
true = np.asarray(truth(where))
measured = true + rng.normal(scale=3e-4, size=true.shape)
measured[:, 2] += 5e-3 * true[:, 2] ** 2
data = PositionSet.from_arrays(measured, alpha, beta, unit="deg", sd=3e-4)

# %%
# Fit and diagnosis: the candidates are effects of the catalogue on the outputs.
diagnosis = tumblecal.diagnose(data, chain=chain)
print(diagnosis.verdict, diagnosis.labels)
gain = diagnosis.gain
print(f"held-out error {1e3 * gain.cv_rms_before_g:.2f} -> {1e3 * gain.cv_rms_after_g:.2f} (0.001 of the field)")

# %%
figure = Figure(figsize=(6.4, 3.4), layout="constrained")
axes = figure.subplots()
axes.plot(true[:, 2], 1e3 * diagnosis.nominal.residuals[:, 2], "o", color="0.5", label="model")
axes.plot(true[:, 2], 1e3 * diagnosis.extended.residuals[:, 2], "o", color="tab:green", label="extended model")
axes.set_xlabel("field along z / field")
axes.set_ylabel("residual of z / 0.001 of the field")
axes.legend()
assert "second_order.z" in diagnosis.labels
