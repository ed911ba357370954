"""
Error in use
============

A calibration is judged by the specific force that it returns. The error at 500 held-out orientations, for the
nominal and for the extended model of an instrument with a quadratic z axis.
"""

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

import tumblecal


tumblecal.enable_float64()

rig = tumblecal.read_rig("grid48")
rig = replace(rig, effects=("second_order.z",), truth={**rig.truth, "second_order.z": (2e-3,)})
positions = tumblecal.simulate(rig, seed=8)
diagnosis = tumblecal.diagnose(positions, noise_sd=0.1e-3)
tumblecal.calibrate(positions, noise_sd=0.1e-3).save("nominal.json")
diagnosis.save("extended.json")

# %%
# Readings of the same instrument at random orientations, by plain numpy.
rng = np.random.default_rng(1)
force = rng.normal(size=(500, 3))
force /= np.linalg.norm(force, axis=1)[:, None]
gamma = rig.truth["gamma"]
triad = np.array([[1, 0, 0], [gamma[0], 1, 0], [gamma[1], gamma[2], 1]])
inputs = force @ triad.T
readings = (1 + np.array(rig.truth["dK"])) * inputs + np.array(rig.truth["bias"])
readings[:, 2] += 2e-3 * inputs[:, 2] ** 2

# %%
figure = Figure(figsize=(6.4, 3.4), layout="constrained")
axes = figure.subplots()
for name, colour in (("nominal", "0.5"), ("extended", "tab:green")):
    error = 1e3 * (tumblecal.load(f"{name}.json").corrected(readings) - force)
    axes.plot(force[:, 2], error[:, 2], ".", color=colour, label=f"{name} model")
axes.set_xlabel("specific force along z / g")
axes.set_ylabel("error of the corrected z / mg")
axes.legend()
