"""
Allan deviation of a recording
==============================

A recording at rest is simulated with white and random-walk noise; its overlapping Allan deviation shows both.
"""

import numpy as np
from matplotlib.figure import Figure

from tumblecal.noise.allan import overlapping_allan


rng = np.random.default_rng(3)
rate_hz, samples = 100.0, 60_000
white = rng.normal(0, 1e-3, samples)  # g
walk = np.cumsum(rng.normal(0, 2e-6, samples))
allan = overlapping_allan([white + walk], rate_hz)

# %%
figure = Figure(figsize=(6.4, 3.6), layout="constrained")
axes = figure.subplots()
axes.fill_between(allan.tau_s, 1e3 * allan.low, 1e3 * allan.high, color="0.85", label="confidence band")
axes.loglog(allan.tau_s, 1e3 * allan.deviation, "o-", label="one axis")
axes.set_xlabel("averaging time / s")
axes.set_ylabel("Allan deviation / mg")
axes.legend()
