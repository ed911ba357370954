"""
Correlations of the parameters
==============================

The correlation matrix of the paper's plan. dK_x, bias_x and dbeta_0 have correlations near one: only a combination
of them is determined well.
"""

import numpy as np
from matplotlib.figure import Figure

import tumblecal


tumblecal.enable_float64()

positions = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)
fit = tumblecal.calibrate(positions, noise_sd=0.15e-3).exact

# %%
figure = Figure(figsize=(6.4, 5.6), layout="constrained")
axes = figure.subplots()
image = axes.imshow(fit.correlation, cmap="RdBu_r", vmin=-1, vmax=1)
axes.set_xticks(np.arange(len(fit.names)), fit.names, rotation=90)
axes.set_yticks(np.arange(len(fit.names)), fit.names)
figure.colorbar(image, label="correlation")
