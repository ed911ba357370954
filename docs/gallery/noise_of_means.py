"""
Noise of position means
=======================

White noise averages out over a dwell; flicker noise hardly does. The uncertainty of the mean of one dwell, for
dwells of different length.
"""

import numpy as np
from matplotlib.figure import Figure

from tumblecal.noise import Flicker, Noise, White, regular_dwells


noise = Noise((White(np.full(3, 1e-3)), Flicker(np.full(3, 20e-6))))
dwells_s = np.array([1.0, 2.0, 5.0, 10.0, 30.0, 100.0])
sd = [np.sqrt(noise.mean_covariance(regular_dwells(4, dwell, 10.0, 100.0))[0, 0, 0]) for dwell in dwells_s]

# %%
figure = Figure(figsize=(6.4, 3.4), layout="constrained")
axes = figure.subplots()
axes.loglog(dwells_s, 1e3 * np.array(sd), "o-", label="white and flicker noise")
axes.loglog(dwells_s, 1e3 * sd[0] / np.sqrt(dwells_s), "--", color="0.5", label="if it were white")
axes.set_xlabel("dwell / s")
axes.set_ylabel("standard uncertainty of the mean / mg")
axes.legend()
