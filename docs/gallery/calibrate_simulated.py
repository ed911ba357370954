"""
Calibrate a simulated triad
===========================

A rig that comes with the package is simulated and calibrated by the exact chain. The residuals show only noise.
"""

import tumblecal


tumblecal.enable_float64()

rig = tumblecal.read_rig("paper24")
positions = tumblecal.simulate(rig, seed=1)
calibrated = tumblecal.calibrate(positions, noise_sd=0.15e-3)  # g
print(calibrated)

# %%
# Residuals of all positions, axis by axis.
figure = calibrated.plot_residuals()
