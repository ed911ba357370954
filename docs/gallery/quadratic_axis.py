"""
A quadratic axis, found and corrected
=====================================

The z axis of a simulated instrument responds quadratically. The nominal model is rejected, the cause is named, and
the residuals of the extended model show only noise.
"""

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

import tumblecal


tumblecal.enable_float64()

rig = tumblecal.read_rig("grid48")
rig = replace(rig, effects=("second_order.z",), truth={**rig.truth, "second_order.z": (0.6e-3,)})  # g/g^2
positions = tumblecal.simulate(rig, seed=4)
diagnosis = tumblecal.diagnose(positions, noise_sd=0.1e-3)
print(diagnosis)

# %%
# Residuals of the z axis against its input, before and after.
before, after = (1e3 * fit.residuals[:, 2] for fit in (diagnosis.nominal, diagnosis.extended))  # mg
z = positions.readings[:, 2]
figure = Figure(figsize=(6.4, 3.6), layout="constrained")
axes = figure.subplots()
axes.axhspan(-0.2, 0.2, color="0.9", label="95 % of the noise")
axes.plot(z, before, "o", color="0.5", label="nominal model")
axes.plot(z, after, "o", color="tab:green", label="with K2 of z")
axes.set_xlabel("input of z / g")
axes.set_ylabel("residual of z / mg")
axes.legend()
print(f"rms {np.std(before):.3f} -> {np.std(after):.3f} mg")
