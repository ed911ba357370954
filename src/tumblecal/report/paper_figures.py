"""Figures of the study of the paper: its figures 4 to 9, and the audit of Table 1."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tumblecal.data import PositionSet
from tumblecal.estimation import Fit
from tumblecal.ground.units import shown
from tumblecal.report.drawing import AXIS_COLOUR, INK, METHOD_COLOUR, MUTED, draw_each, new_figure, save
from tumblecal.studies.paper_audit import Audit
from tumblecal.studies.paper_study import PaperStudy


# The paper's figures: number, leaf, title.
GROUPS = (
    (4, "dK", "Scale factor errors"),
    (5, "bias", "Biases"),
    (6, "dtheta", "Mount angles"),
    (7, "gamma", "Non-orthogonalities"),
    (8, "dbeta", "Pitch-setting errors"),
)
# Methods that agree overlap: the lower one is wide, the exact fit dashed above it.
_BELOW = 2.6
_EXACT: dict[str, Any] = {"color": METHOD_COLOUR["exact"], "lw": 1.2, "ls": (0, (4, 2)), "label": "exact"}


def draw_study(study: PaperStudy, folder: Path) -> dict[str, str]:
    """Draw figures 4 to 9; returns file name and caption of those drawn."""
    captions, figures = {}, dict[str, Callable[[], Figure]]()
    for number, leaf, title in GROUPS:
        name = f"figure{number}_{leaf}.svg"
        figures[name] = partial(_group_figure, study, leaf)
        captions[name] = (
            f"Figure {number}. {title}: least squares of each data set alone (dots), Kalman filter (blue) and exact fit (red, "
            "dashed) of all sets so far, with the true value. Bands: 2 standard deviations of one set (grey) and of the filter "
            "(blue)."
        )
    figures["figure9_running_means.svg"] = partial(_means_figure, study)
    captions["figure9_running_means.svg"] = (
        "Figure 9. Running mean of least squares, Kalman filter and exact fit of all sets so far, close up: the error in "
        "standard deviations of one set. Band: 2 standard deviations of the mean."
    )
    return {name: captions[name] for name in draw_each(folder, figures, save)}


def _places(study: PaperStudy, leaf: str) -> list[int]:
    return [index for index, name in enumerate(study.names) if name.split("_")[0] == leaf]


def _group_figure(study: PaperStudy, leaf: str) -> Figure:
    figure = new_figure(7.5, 2.7)
    number = np.arange(1, len(study.single) + 1)
    axes = figure.subplots(1, 3, sharex=True)
    for axis, index in zip(axes, _places(study, leaf), strict=True):
        unit, factor = shown(study.units[index])
        truth, sd = study.truth[index] * factor, study.single_sd[index] * factor
        axis.axhspan(truth - 2 * sd, truth + 2 * sd, color="#f2f2f2", zorder=0, label="2 sd of one set")
        dots = {"ms": 2, "color": METHOD_COLOUR["least squares"], "label": "least squares, each set"}
        axis.plot(number, study.single[:, index] * factor, ".", **dots)
        centre, spread = study.kalman[:, index] * factor, 2 * study.kalman_sd[:, index] * factor
        blue, band = METHOD_COLOUR["Kalman"], (centre - spread, centre + spread)
        axis.fill_between(number, *band, color=blue, alpha=0.18, lw=0, label="2 sd of Kalman")
        axis.axhline(truth, color=INK, lw=0.9, ls=":", label="truth")
        axis.plot(number, centre, color=blue, lw=_BELOW, alpha=0.6, label="Kalman")
        axis.plot(number, study.exact_mean[:, index] * factor, **_EXACT)
        axis.set_title(f"{study.names[index]} / {unit}")
        axis.set_xlabel("data set")
    key = {"loc": "outside lower center", "ncols": 6, "columnspacing": 1.2, "handlelength": 1.6}
    figure.legend(*axes[0].get_legend_handles_labels(), **key)
    return figure


def _means_figure(study: PaperStudy) -> Figure:
    figure = new_figure(7.5, 8.6)
    number = np.arange(1, len(study.single) + 1)
    axes = figure.subplots(5, 3, sharex=True, sharey=True)
    band = 2 / np.sqrt(number)
    for row, (_, leaf, _) in enumerate(GROUPS):
        for axis, index in zip(axes[row], _places(study, leaf), strict=True):
            sd, truth = study.single_sd[index], study.truth[index]
            axis.fill_between(number, -band, band, color="#ececec", lw=0, label="2 sd of the mean")
            estimates = (study.mean, study.kalman, study.exact_mean)
            mean, kalman, exact = ((each[:, index] - truth) / sd for each in estimates)
            axis.axhline(0, color=INK, lw=0.8, ls=":")
            axis.plot(number, mean, color=METHOD_COLOUR["running mean"], lw=4.5, alpha=0.5, label="running mean")
            axis.plot(number, kalman, color=METHOD_COLOUR["Kalman"], lw=_BELOW, alpha=0.6, label="Kalman")
            axis.plot(number, exact, **_EXACT)
            axis.set_title(study.names[index])
            axis.set_ylim(-0.8, 0.8)
    for axis in axes[-1]:
        axis.set_xlabel("data sets so far")
    for row in axes:
        row[0].set_ylabel("error / sd of one set")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def draw_audit(audit: Audit, table1: Fit, folder: Path) -> dict[str, str]:
    """Draw the residuals of Table 1 under each parameter set; returns file name and caption, if it was drawn."""
    caption = (
        "Residuals of the measured Table 1 under its best fit, under the parameters of the paper's simulation, and under the "
        "published result of the same run. Titles state different scales."
    )
    return dict.fromkeys(
        draw_each(folder, {"table1_residuals.svg": partial(_audit_figure, audit, table1)}, save), caption
    )


def _audit_figure(audit: Audit, table1: Fit) -> Figure:
    figure = new_figure(7.5, 5.4)
    sets = [("best exact fit", table1.residuals), *((e.name, e.residuals) for e in audit.explanations[:2])]
    rows = figure.subplots(len(sets), 1, sharex=True)
    reach = 1.2 * np.max(np.abs([residuals for _, residuals in sets[:2]]))
    for axis, (name, residuals) in zip(rows, sets, strict=True):
        _residual_panel(axis, table1.data, residuals)
        times = np.ceil(np.max(np.abs(residuals)) / reach)
        axis.set_ylim(-1e3 * reach * times, 1e3 * reach * times)
        scale = f"; SCALE {times:.0f} TIMES LARGER" if times > 1 else ""
        size = f"rms {np.sqrt(np.mean(residuals**2)) * 1e3:.3f} mg"
        axis.set_title(f"Table 1 less prediction of: {name} ({size}{scale})", loc="left")
    rows[-1].set_xticks(range(len(table1.data)), table1.data.names, rotation=90)
    figure.legend(*rows[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _residual_panel(axis, data: PositionSet, residuals: np.ndarray) -> None:
    """Residuals of the three axes by position, with lines between pitch settings."""
    position = np.arange(len(data))
    for column, name in enumerate("xyz"):
        across, size, colour = position + (column - 1) * 0.22, residuals[:, column] * 1e3, AXIS_COLOUR[name]
        axis.vlines(across, 0, size, color=colour, lw=1.1)
        axis.plot(across, size, ".", color=colour, ms=4, label=f"axis {name}")
    axis.axhline(0, color=INK, lw=0.7)
    for border in np.nonzero(np.diff(data.beta_deg))[0]:
        axis.axvline(border + 0.5, color=MUTED, lw=0.8, ls=":")
    axis.set_ylabel("mg")
