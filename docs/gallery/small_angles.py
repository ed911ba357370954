"""
When are small angles good enough?
==================================

The instrument of a rig is turned in its mounting by growing angles, without noise. The error of the harmonic
equations grows with the square of the angle; the exact chain has none.
"""

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

import tumblecal


tumblecal.enable_float64()

rig = tumblecal.read_rig("paper24")
angles = np.array([0.5e-3, 1e-3, 2e-3, 5e-3, 10e-3, 20e-3])  # rad
errors = {"exact": [], "harmonic": []}
for angle in angles:
    truth = {**rig.truth, "dtheta": (angle, -angle, angle)}
    positions = tumblecal.simulate(replace(rig, truth=truth), seed=0, noise_sd=0.0)
    calibrated = tumblecal.calibrate(positions, noise_sd=0.15e-3)
    for method in errors:
        errors[method].append(abs(calibrated.fits[method].value("dK_y") - rig.truth["dK"][1]))

# %%
figure = Figure(figsize=(6.4, 4.0), layout="constrained")
axes = figure.subplots()
axes.loglog(angles * 1e3, np.array(errors["harmonic"]) * 1e3, "o-", label="harmonic least squares")
axes.loglog(angles * 1e3, np.maximum(errors["exact"], 1e-16) * 1e3, "s-", label="exact chain")
axes.set_xlabel("mounting angle / mrad")
axes.set_ylabel("error of dK_y / 1e-3")
axes.legend()
