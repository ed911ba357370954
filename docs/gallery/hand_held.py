"""
Orientations by hand
====================

Without a dividing head only the size of gravity calibrates. Scale factors, biases and non-orthogonality are
determined; the mounting angles are not.
"""

import tumblecal


tumblecal.enable_float64()

rig = tumblecal.read_rig("hand_held")
positions = tumblecal.simulate(rig, seed=2)
calibrated = tumblecal.calibrate(positions, chain=rig.chain(rig.where), noise_sd=0.2e-3)
print(calibrated.table())

# %%
figure = calibrated.plot_residuals()
