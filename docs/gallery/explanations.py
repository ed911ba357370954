"""
Probabilities of the explanations
=================================

Every set of causes has a posterior probability; sets that these data cannot distinguish form one class.
"""

import tumblecal


tumblecal.enable_float64()

positions = tumblecal.simulate(tumblecal.read_rig("hidden_effect"), seed=4)
diagnosis = tumblecal.diagnose(positions, noise_sd=0.1e-3)
print(diagnosis.table())

# %%
figure = diagnosis.plot_explanations()
