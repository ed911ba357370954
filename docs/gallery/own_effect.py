"""
An effect of your own
=====================

An effect is a link of the chain whose coefficients are zero in the nominal model. This one is a fourth-order
nonlinearity of the y axis: it is added to the catalogue, hidden in simulated data, and found.
"""

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

import tumblecal
from tumblecal.diagnosis import Diagnoser
from tumblecal.effects import catalogue, output_effect


tumblecal.enable_float64()

fourth_order = output_effect(
    "fourth_order.y",
    "y",
    lambda u, where: u[1] ** 4,
    unit="mg/g^4",
    typical=0.2,
    physics="K4 u^4",
    cause="Fourth-order nonlinearity of the y axis.",
    advice="Apply the term from the extended calibration.",
    forms=[{"axis": "y", "powers": [0, 4, 0]}],
)
entries = {**catalogue(), fourth_order.id: fourth_order}

# %%
# The same instrument, by plain numpy, with K4 = 2 mg/g^4 on y.
positions = tumblecal.simulate(tumblecal.read_rig("grid48"), seed=9)
readings = positions.readings.copy()
readings[:, 1] += 2e-3 * readings[:, 1] ** 4
diagnosis = Diagnoser(entries=entries)(replace(positions, readings=readings), noise_sd=0.1e-3)
print(diagnosis.verdict, diagnosis.labels)

# %%
figure = Figure(figsize=(6.4, 3.4), layout="constrained")
axes = figure.subplots()
axes.plot(readings[:, 1], 1e3 * diagnosis.nominal.residuals[:, 1], "o", color="0.5", label="nominal model")
axes.plot(readings[:, 1], 1e3 * diagnosis.extended.residuals[:, 1], "o", color="tab:green", label="extended model")
axes.set_xlabel("input of y / g")
axes.set_ylabel("residual of y / mg")
axes.legend()
assert np.std(diagnosis.extended.residuals) < np.std(diagnosis.nominal.residuals)
