"""Figures of a calibration: residuals by position, and the methods side by side."""

from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from tumblecal.estimation.fit import Fit
from tumblecal.estimation.methods import Calibrated
from tumblecal.report.drawing import AXIS_COLOUR, BAND, INK, METHOD_COLOUR, draw_each, new_figure, save
from tumblecal.show.fit import TITLES


# Differences up to this many standard uncertainties have a linear scale; the band of 1 u is drawn if the data reach it.
_LINEAR, _BAND_SEEN = 10.0, 0.8


def draw_calibration(folder: Path, calibrated: Calibrated) -> list[str]:
    """Draw `residuals.svg`, and `methods.svg` if other methods apply, into `folder`; returns the names of those drawn."""
    figures = {"residuals.svg": partial(residuals_figure, calibrated.exact)}
    if len(calibrated.fits) > 1:
        figures["methods.svg"] = partial(methods_figure, calibrated)
    return [*draw_each(folder, figures, save)]


def residuals_figure(exact: Fit) -> Figure:
    """Residuals against the spindle angle: a row for each axis, a column for each pitch setting (at most eight)."""
    data = exact.data
    sd = float(np.median(exact.problem.sd)) if exact.noise == "stated" else exact.sigma
    called = data.pitch_setting_deg
    betas = np.unique(called)[:8]
    figure = new_figure(max(4.0, 1.9 * len(betas) + 1.2), 5.0)
    panels = figure.subplots(3, len(betas), sharex=True, sharey=True, squeeze=False)
    for column, beta in enumerate(betas):
        rows = called == beta
        for row, name in enumerate("xyz"):
            panel = panels[row, column]
            bars = None if data.sd is None else 2e3 * data.sd[rows, row]
            values, look = 1e3 * exact.residuals[rows, row], {"ms": 3.5, "color": AXIS_COLOUR[name], "elinewidth": 0.8}
            panel.errorbar(data.alpha_deg[rows], values, yerr=bars, fmt="o", **look)
            if data.sd is None:
                panel.axhspan(-2e3 * sd, 2e3 * sd, color=BAND, zorder=0)
            panel.axhline(0, color=INK, lw=0.7)
            if row == 0:
                panel.set_title(f"beta {beta:g} deg")
            if column == 0:
                panel.set_ylabel(f"{name}: measured -\npredicted / mg")
            if row == 2:
                panel.set_xlabel("alpha / deg")
                panel.set_xticks([0, 90, 180, 270])
    noise = "stated noise" if exact.noise == "stated" else "residuals"
    band = f"grey band: 2 standard deviations of the {noise}, {2e3 * sd:.2g} mg"
    words = band if data.sd is None else "bars: 2 standard deviations, stated"
    figure.supxlabel(words, fontsize=8, color="#555555")
    return figure


def methods_figure(calibrated: Calibrated) -> Figure:
    """Difference of every method from the exact fit for every parameter, in standard uncertainties."""
    exact = calibrated.exact
    figure = new_figure(7.5, 0.24 * len(exact.names) + 1.2)
    axis = figure.subplots()
    height = np.arange(len(exact.names))
    colours = {"harmonic": METHOD_COLOUR["running mean"], "kalman": METHOD_COLOUR["Kalman"]}
    marks = {"harmonic": "s", "kalman": "o"}
    farthest = 0.0
    for name, result in calibrated.fits.items():
        if name == "exact":
            continue
        common = [k for k, parameter in enumerate(exact.names) if parameter in result.names]
        shift = [(result.value(exact.names[k]) - exact.values[k]) / exact.sd[k] for k in common]
        farthest = max(farthest, float(np.max(np.abs(shift), initial=0.0)))
        axis.plot(shift, height[common], marks[name], color=colours[name], ms=5, mfc="none", label=TITLES[name])
    axis.axvline(0, color=METHOD_COLOUR["exact"], lw=1.2, label="exact")
    if farthest > _LINEAR:
        axis.set_xscale("symlog", linthresh=1.0)
    if farthest > _BAND_SEEN:
        axis.axvspan(-1, 1, color=BAND, zorder=0, label="1 u")
    reach = 1.15 * max(farthest, 1e-6)
    axis.set_xlim(-reach, reach)
    axis.set_yticks(height, exact.names)
    axis.invert_yaxis()
    axis.set_xlabel("difference from the exact fit / u")
    axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure
