"""Draws docs/before_after.svg, the picture of the README: residuals before and after, next to the verdict."""

from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import tumblecal


matplotlib.rcParams["svg.hashsalt"] = "tumblecal"  # the same file each time
tumblecal.enable_float64()

rig = tumblecal.read_rig("hidden_effect")
truth = {name: values for name, values in rig.truth.items() if name != "bias_drift.x"} | {"second_order.z": (1.5e-3,)}
rig = replace(rig, effects=("second_order.z",), truth=truth)
positions = tumblecal.simulate(rig, seed=4)
diagnosis = tumblecal.diagnose(positions, noise_sd=0.1e-3)
fit = diagnosis.extended
coefficient, u = (1e3 * values[fit.names.index("second_order.z")] for values in (fit.values, fit.sd))
before, after = (1e3 * fit.residuals[:, 2] for fit in (diagnosis.nominal, diagnosis.extended))
z, grid = positions.readings[:, 2], np.linspace(-1, 1, 200)
# The nominal fit absorbs a constant and a slope of the quadratic term.
shape = np.polynomial.Polynomial.fit(z, before, 2)

figure = Figure(figsize=(9.6, 3.6), layout="constrained")
left, right = figure.subplots(1, 2, width_ratios=(1, 1.15))
left.axhspan(-0.2, 0.2, color="0.92", label="noise, 95 %")
left.plot(grid, shape(grid), color="0.6")
left.plot(z, before, "o", ms=4, color="0.5", label=f"nominal model, rms {np.std(before):.2f} mg")
left.plot(z, after, "o", ms=4, color="tab:green", label=f"with K2 of z, rms {np.std(after):.2f} mg")
left.set(xlabel="input of the z axis / g", ylabel="residual of z / mg")
left.legend(fontsize=8, loc="upper center")
left.set_ylim(-0.6, 1.1)
p_value, gain = diagnosis.screened.detection.p_value, diagnosis.gain
text = f"""{diagnosis.verdict.upper()}
The z axis responds quadratically,
K2 = ({coefficient:.2f} ± {u:.2f}) mg/g²

USE        yes: calibration.json contains the term
EVIDENCE   nominal model rejected, p {f"= {p_value:.0e}" if p_value > 1e-100 else "< 1e-100"}
           held-out error {1e3 * gain.cv_rms_before_g:.3f} → {1e3 * gain.cv_rms_after_g:.3f} mg
           probability {diagnosis.best.probability:.2f}"""
right.axis("off")
right.text(0, 0.85, text, family="monospace", fontsize=10.5, va="top", linespacing=1.5)
figure.savefig(Path(__file__).parent / "before_after.svg", metadata={"Date": None})
