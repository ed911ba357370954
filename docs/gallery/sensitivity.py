"""
Sensitivity to each reading
===========================

The fit is differentiable. The derivative of bias_z with respect to every reading shows which positions determine
it.
"""

import numpy as np
from matplotlib.figure import Figure

import tumblecal
from tumblecal.estimation import exact, problem_of


tumblecal.enable_float64()

positions = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)
problem = problem_of(positions, noise_sd=0.15e-3)
fit = exact.fit(problem)
slopes = np.asarray(exact.sensitivity(problem, fit.values))[fit.names.index("bias_z")]  # (positions, 3)

# %%
figure = Figure(figsize=(6.4, 3.4), layout="constrained")
axes = figure.subplots()
for axis, name in enumerate("xyz"):
    axes.plot(slopes[:, axis], "o-", label=f"reading of {name}")
axes.set_xlabel("position")
axes.set_ylabel("d bias_z / d reading")
axes.legend()
