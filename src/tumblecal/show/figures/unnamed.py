"""Picture of an unexplained error: where it is in the plane of the head's angles, and its candidate law."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.findings.candidate_law import Law, law_words
from tumblecal.diagnosis.findings.unexplained import Unnamed
from tumblecal.ground.axes import AXES
from tumblecal.show.figures.drawing import (
    AXIS_COLOUR,
    CARD,
    INK,
    MUTED,
    OfAxes,
    angle_ticks,
    marks,
    new_panel,
    new_panels,
)
from tumblecal.show.figures.variables import conditions


def unnamed_figure(diagnosis: Diagnosis) -> Figure | None:
    """A map of each output's errors and, if there is a candidate law, the most affected output against its variable; None
    if nothing is unexplained."""
    if (unnamed := diagnosis.unnamed) is None:
        return None
    count = 3 if unnamed.law is None else 4
    figure, panels = new_panels(2.7, 1, count, 2.4 * count)
    for axis in range(3):
        _map(panels[0, axis], diagnosis, unnamed, axis)
    if unnamed.law is not None:
        _law(panels[0, 3], diagnosis, unnamed, unnamed.law)
    return figure


def small_unnamed_figure(diagnosis: Diagnosis, unnamed: Unnamed) -> Figure:
    """For a card: the most affected output against the variable of the candidate law, without a law its map."""
    figure, panel = new_panel(1.9, CARD)
    if unnamed.law is not None:
        _law(panel, diagnosis, unnamed, unnamed.law)
    else:
        _map(panel, diagnosis, unnamed, _most_affected(unnamed.excess.values))
    return figure


def _most_affected(errors: OfAxes) -> int:
    return int(np.argmax(np.max(np.abs(errors), axis=0)))


def _map(panel: Axes, diagnosis: Diagnosis, unnamed: Unnamed, axis: int) -> None:
    data, excess = diagnosis.data, unnamed.excess
    largest = 1e3 * float(np.max(np.abs(excess.values)))
    colours = {"c": 1e3 * excess.values[:, axis], "cmap": "RdBu_r", "vmin": -largest, "vmax": largest}
    drawn = panel.scatter(data.alpha_deg, data.beta_deg, s=26, edgecolors=MUTED, lw=0.3, **colours)
    if excess.region:
        here = excess.positions
        panel.plot(data.alpha_deg[here], data.beta_deg[here], "o", ms=9, mfc="none", color=INK)
    panel.set(title=f"{AXES[axis]} / mg", xlabel="alpha / °", ylabel="beta / °")
    angle_ticks(panel.xaxis)
    panel.figure.colorbar(drawn, ax=panel)


def _law(panel: Axes, diagnosis: Diagnosis, unnamed: Unnamed, law: Law) -> None:
    data, inputs = diagnosis.data, diagnosis.screened.at.evaluation.inputs
    variables = {"alpha": ("°", data.alpha_deg)} | conditions(data)
    variables |= {f"u_{name}": ("g", inputs[:, k]) for k, name in enumerate(AXES)}
    against, axis = law.terms[0].form.against, _most_affected(law.signal)
    unit, across = variables[against]
    marks(panel, across, 1e3 * unnamed.excess.values[:, axis], AXIS_COLOUR[AXES[axis]], "measured")
    marks(panel, across, 1e3 * _as_fitted(unnamed, law)[:, axis], INK, "law", marker="x")
    panel.axhline(0, color=INK, lw=0.6)
    panel.set(xlabel=f"{against} / {unit}", ylabel=f"{AXES[axis]} / mg")
    panel.set_title(law_words(law)[:44], fontsize=7)
    panel.legend()


def _as_fitted(unnamed: Unnamed, law: Law) -> OfAxes:
    """What the fit leaves of the law, whose parameters take up a part of it, g; in a region the law itself."""
    if unnamed.excess.region:
        return law.signal
    fit = unnamed.fit
    rows = np.zeros(len(fit.rows))
    rows[: law.signal.size] = fit.problem.rows(law.signal)
    remaining = rows - fit.column_space @ (fit.column_space.T @ rows)
    return fit.problem.unwhitened(remaining[: law.signal.size])
