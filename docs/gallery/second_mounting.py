"""
Gain of a second mounting
=========================

With the x axis along the spindle, scale factor, bias and pitch error of that axis are almost fully correlated. A
mounting turned by 90 degrees determines them.
"""

import numpy as np
from matplotlib.figure import Figure

import tumblecal


tumblecal.enable_float64()

names = ["dK_x", "dK_y", "dK_z", "bias_x", "bias_y", "bias_z", "gamma_21", "gamma_31", "gamma_32"]
uncertainty = {}
for example in ("paper24", "remount"):
    rig = tumblecal.read_rig(example)
    positions = tumblecal.simulate(rig, seed=1)
    fit = tumblecal.calibrate(positions, chain=rig.chain(rig.where), noise_sd=0.15e-3).exact
    uncertainty[example] = [1e3 * fit.sd[fit.names.index(name)] for name in names]

# %%
figure = Figure(figsize=(6.4, 3.6), layout="constrained")
axes = figure.subplots()
places = np.arange(len(names))
axes.bar(places - 0.2, uncertainty["paper24"], 0.4, label="24 positions, one mounting")
axes.bar(places + 0.2, uncertainty["remount"], 0.4, label="48 positions, two mountings")
axes.set_xticks(places, names)
axes.set_yscale("log")
axes.set_ylabel("standard uncertainty / 1e-3, mg, mrad")
axes.legend()
