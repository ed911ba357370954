"""
Losses of export formats
========================

A calibration with a quadratic term is written in the formats of other programs. Each states its loss in mg.
"""

from dataclasses import replace

from matplotlib.figure import Figure

import tumblecal
from tumblecal.devices import TARGETS, Export, losses


tumblecal.enable_float64()

rig = tumblecal.read_rig("grid48")
rig = replace(rig, effects=("second_order.z",), truth={**rig.truth, "second_order.z": (1e-3,)})
diagnosis = tumblecal.diagnose(tumblecal.simulate(rig, seed=4), noise_sd=0.1e-3)
diagnosis.save("calibration.json")
calibration = tumblecal.load("calibration.json")
print(calibration)

# %%
# The largest error of each format over all orientations, as `tumblecal export` states it.
largest = {}
for name, target in TARGETS.items():
    export = Export(target.carried(calibration, None), 9.80665)
    lost = losses(target, export, calibration, target.write(export))
    largest[name] = max((loss.mg for loss in lost), default=0.0)
    print(f"{name:12}", "; ".join(map(str, lost)) or "no loss")

# %%
figure = Figure(figsize=(7, 3.5), layout="constrained")
axes = figure.subplots()
axes.barh(list(largest), list(largest.values()))
axes.set_xlabel("largest loss / mg")
axes.grid(axis="x", alpha=0.3)
