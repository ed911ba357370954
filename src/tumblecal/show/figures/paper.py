"""Figures of the study of the paper: its figures 4 to 9, and the audit of Table 1."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tumblecal.estimation import Fit
from tumblecal.ground.units import shown
from tumblecal.show.figures.drawing import (
    AXIS_COLOUR,
    BAND,
    BLUE,
    INK,
    MUTED,
    OUTSIDE,
    Figures,
    new_panels,
    with_legend,
)
from tumblecal.studies.paper_audit import Audit
from tumblecal.studies.paper_study import PaperStudy


# The paper's figures by leaf: number, title.
GROUPS = {
    "dK": (4, "Scale factor errors"),
    "bias": (5, "Biases"),
    "dtheta": (6, "Mount angles"),
    "gamma": (7, "Non-orthogonalities"),
    "dbeta": (8, "Pitch-setting errors"),
}
# Methods that agree overlap: the lower one is wide, the exact fit dashed above it.
_TRUTH: dict[str, Any] = {"color": INK, "lw": 0.9, "ls": ":", "label": "truth"}
_MEAN: dict[str, Any] = {"color": "#E69F00", "lw": 4.5, "alpha": 0.5, "label": "running mean"}
_KALMAN: dict[str, Any] = {"color": BLUE, "lw": 2.6, "alpha": 0.6, "label": "Kalman"}
_EXACT: dict[str, Any] = {"color": OUTSIDE, "ls": (0, (4, 2)), "label": "exact"}


def _drawn(study: PaperStudy) -> np.ndarray:
    """The data sets that are drawn: the first fifty, then every sixth; on a page more would only take space."""
    sets = np.arange(len(study.single))
    return sets[(sets < 50) | (sets % 6 == 0)]


def group_figure(leaf: str, study: PaperStudy) -> Figure:
    """One kind of parameter: least squares of each set, Kalman filter and exact fit of all sets so far, with the truth."""
    figure, panels = new_panels(2.7, 1, 3, sharex=True)
    sets = _drawn(study)
    number = sets + 1
    places = [index for index, name in enumerate(study.names) if name.startswith(f"{leaf}_")]
    for panel, index in zip(panels[0], places, strict=True):
        unit, factor = shown(study.units[index])
        truth, sd = factor * study.truth[index], factor * study.single_sd[index]
        centre, half = factor * study.kalman[sets, index], 2 * factor * study.kalman_sd[sets, index]
        panel.axhspan(truth - 2 * sd, truth + 2 * sd, color=BAND, alpha=0.6, lw=0, label="2 sd of one set")
        panel.plot(number, factor * study.single[sets, index], ".", ms=2, color=MUTED, label="least squares, each set")
        panel.fill_between(number, centre - half, centre + half, color=BLUE, alpha=0.18, lw=0, label="2 sd of Kalman")
        panel.axhline(truth, **_TRUTH)
        panel.plot(number, centre, **_KALMAN)
        panel.plot(number, factor * study.exact_mean[sets, index], **_EXACT)
        panel.set(title=f"{study.names[index]} / {unit}", xlabel="data set")
    return with_legend(figure, 6)


def means_figure(study: PaperStudy) -> Figure:
    """Errors of the estimates of all sets so far, in standard deviations of one set."""
    figure, panels = new_panels(8.6, len(GROUPS), 3, sharex=True, sharey=True)
    sets = _drawn(study)
    number = sets + 1
    band = 2 / np.sqrt(number)
    estimates = ((study.mean, _MEAN), (study.kalman, _KALMAN), (study.exact_mean, _EXACT))
    for index, panel in enumerate(panels.ravel()):
        panel.fill_between(number, -band, band, color=BAND, lw=0, label="2 sd of the mean")
        panel.axhline(0, **_TRUTH)
        for values, look in estimates:
            panel.plot(number, (values[sets, index] - study.truth[index]) / study.single_sd[index], **look)
        panel.set(title=study.names[index], ylim=(-0.8, 0.8))
        panel.set(xlabel="data sets so far", ylabel="error / sd of one set")
        panel.label_outer()
    return with_legend(figure, 5)


def audit_figure(audit: Audit, table1: Fit) -> Figure:
    """Residuals of the measured Table 1 under each parameter set."""
    sets = {"best exact fit": table1.residuals} | {each.name: each.residuals for each in audit.explanations[:2]}
    figure, panels = new_panels(5.4, len(sets), sharex=True)
    position, reach = np.arange(len(table1.data)), 1.2 * np.max(np.abs([*sets.values()][:2]))
    for panel, (name, residuals) in zip(panels[:, 0], sets.items(), strict=True):
        for k, (axis, colour) in enumerate(AXIS_COLOUR.items()):
            look = {"linefmt": colour, "markerfmt": ".", "basefmt": " ", "label": f"axis {axis}"}
            panel.stem(position + 0.22 * (k - 1), 1e3 * residuals[:, k], **look)
        panel.axhline(0, color=INK, lw=0.7)
        times = np.ceil(np.max(np.abs(residuals)) / reach)
        panel.set(ylim=(-1e3 * reach * times, 1e3 * reach * times), ylabel="mg")
        scale = f"; SCALE {times:.0f} TIMES LARGER" if times > 1 else ""
        size = f"rms {np.sqrt(np.mean(residuals**2)) * 1e3:.3f} mg"
        panel.set_title(f"Table 1 less prediction of: {name} ({size}{scale})")
    panels[-1, 0].set_xticks(position, table1.data.names, rotation=90)
    return with_legend(figure)


FIGURES: Figures = {
    f"figure{number}_{leaf}.svg": partial(group_figure, leaf) for leaf, (number, _) in GROUPS.items()
} | {"figure9_running_means.svg": means_figure}
AUDIT_FIGURES: Figures = {"table1_residuals.svg": audit_figure}
