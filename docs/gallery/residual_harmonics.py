"""
Harmonics in the residuals
==========================

Errors of the head and of the sensor appear at different harmonics of the spindle angle. A second-order nonlinearity
makes a second harmonic.
"""

from dataclasses import replace

import tumblecal


tumblecal.enable_float64()

rig = tumblecal.read_rig("grid48")
rig = replace(rig, effects=("second_order.y",), truth={**rig.truth, "second_order.y": (1e-3,)})
diagnosis = tumblecal.diagnose(tumblecal.simulate(rig, seed=2), noise_sd=0.1e-3)

# %%
figure = diagnosis.plot_harmonics()
