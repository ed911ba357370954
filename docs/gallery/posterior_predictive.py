"""
Posterior predictive check
==========================

Data simulated from the fitted model are compared with the measured ones, before and after the extension.
"""

import tumblecal


tumblecal.enable_float64()

positions = tumblecal.simulate(tumblecal.read_rig("hidden_effect"), seed=7)
diagnosis = tumblecal.diagnose(positions, noise_sd=0.1e-3)

# %%
figure = diagnosis.plot_predictive()
