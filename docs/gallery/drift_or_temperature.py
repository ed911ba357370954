"""
Drift or temperature?
=====================

The bias of x drifts while the room becomes warmer. Time and temperature are fully correlated in these data, so the
verdict is ambiguous. The next measurement is chosen to separate them.
"""

import tumblecal


tumblecal.enable_float64()

positions = tumblecal.simulate(tumblecal.read_rig("hidden_effect"), seed=4)
diagnosis = tumblecal.diagnose(positions, noise_sd=0.1e-3)
print(diagnosis.verdict, diagnosis.labels)

# %%
figure = diagnosis.plot_columns()

# %%
for position in tumblecal.next_plan(diagnosis).together:
    print(position.alpha_deg, position.beta_deg, position.purpose)
