"""
Two rows exchanged
==================

Two positions of a table have each other's readings. The diagnosis names them and continues with the corrected rows.
"""

from dataclasses import replace

import tumblecal


tumblecal.enable_float64()

positions = tumblecal.simulate(tumblecal.read_rig("grid48"), seed=5)
readings = positions.readings.copy()
readings[[7, 19]] = readings[[19, 7]]
diagnosis = tumblecal.diagnose(replace(positions, readings=readings), noise_sd=0.1e-3)
print(diagnosis)

# %%
figure = diagnosis.plot_residuals()
