"""
An outlier position
===================

One position has an error of 2 mg on y. It is named, and the parameters are those without it.
"""

from dataclasses import replace

import tumblecal


tumblecal.enable_float64()

positions = tumblecal.simulate(tumblecal.read_rig("grid48"), seed=6)
readings = positions.readings.copy()
readings[30, 1] += 2e-3  # g
diagnosis = tumblecal.diagnose(replace(positions, readings=readings), noise_sd=0.1e-3)
print(diagnosis.verdict, diagnosis.labels)

# %%
figure = diagnosis.plot_residuals()
