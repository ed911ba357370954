"""
Exact chain, harmonics and Kalman filter
========================================

All methods are applied to the same positions. At mounting angles of a few mrad the small-angle methods differ from
the exact fit by a small part of its standard uncertainty.
"""

import tumblecal


tumblecal.enable_float64()

positions = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=3)
calibrated = tumblecal.calibrate(positions, noise_sd=0.15e-3)  # g

# %%
# Each method less the exact fit, in units of the exact fit's standard uncertainty.
figure = calibrated.plot_methods()
