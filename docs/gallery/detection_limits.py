"""
Effects that could still be present
===================================

For each effect of the catalogue: the size that these positions detect with probability 0.8. An adequate verdict
excludes larger ones only.
"""

import tumblecal


tumblecal.enable_float64()

positions = tumblecal.simulate(tumblecal.read_rig("grid48"), seed=1)
diagnosis = tumblecal.diagnose(positions, noise_sd=0.1e-3)
print(diagnosis.verdict)

# %%
figure = diagnosis.plot_limits()
