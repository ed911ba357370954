"""Picture of an unexplained error: where it is in the plane of the head's angles, and its candidate law."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.findings.candidate_law import Law, law_words
from tumblecal.diagnosis.findings.unexplained import Unnamed
from tumblecal.ground.axes import AXES
from tumblecal.report.drawing import AXIS_COLOUR, INK, MUTED, new_figure


CAPTION = (
    "Measured minus predicted at every position, by spindle and pitch angle; circled: the region of the excess. Right: the "
    "same against the variable that the candidate law follows (dots), and what the fit leaves of the law (crosses)."
)
_VARIABLES = {"alpha": "alpha / deg", "time": "time / min", "temperature": "temperature / degC"}


def unnamed_figure(diagnosis: Diagnosis) -> Figure | None:
    """A map of each output's errors and, if there is a candidate law, the most affected output against its variable; None
    if nothing is unexplained."""
    own = diagnosis.unnamed
    if own is None:
        return None
    count = 3 if own.law is None else 4
    figure = new_figure(2.4 * count, 2.7)
    panels = figure.subplots(1, count)
    largest = 1e3 * float(np.max(np.abs(own.excess.values))) or 1.0
    for k, panel in enumerate(panels[:3]):
        _map(panel, diagnosis, own, k, largest)
    panels[0].set_ylabel("beta / deg")
    if own.law is not None:
        _law(panels[3], diagnosis, own)
    return figure


def small_unnamed_figure(diagnosis: Diagnosis, own: Unnamed) -> Figure:
    """For a card: the most affected output against the variable of the candidate law, without a law its map."""
    figure = new_figure(3.9, 1.9)
    panel, largest = figure.subplots(), np.max(np.abs(own.excess.values), axis=0)
    if own.law is not None:
        _law(panel, diagnosis, own)
        return figure
    _map(panel, diagnosis, own, int(np.argmax(largest)), 1e3 * float(np.max(largest)) or 1.0, beside=True)
    panel.set_ylabel("beta / deg")
    return figure


def _map(panel: Axes, diagnosis: Diagnosis, own: Unnamed, axis: int, largest: float, *, beside: bool = False) -> None:
    data, values = diagnosis.data, 1e3 * own.excess.values[:, axis]
    drawn = panel.scatter(
        data.alpha_deg, data.beta_deg, c=values, s=26, cmap="RdBu_r", vmin=-largest, vmax=largest, edgecolors=MUTED, lw=0.3
    )  # fmt: skip
    inside = own.excess.positions
    if own.excess.region:
        panel.plot(data.alpha_deg[inside], data.beta_deg[inside], "o", ms=9, mfc="none", color=INK, lw=1.0)
    panel.set_title(f"{AXES[axis]} / mg")
    panel.set_xlabel("alpha / deg")
    panel.set_xticks([0, 180, 360] if np.ptp(data.alpha_deg) > 200 else [])
    across = {} if beside else {"orientation": "horizontal", "shrink": 0.9, "aspect": 25}
    panel.figure.colorbar(drawn, ax=panel, **across)


def _law(panel: Axes, diagnosis: Diagnosis, own: Unnamed) -> None:
    law, data, against = own.law, diagnosis.data, own.law.terms[0].form.against if own.law else "alpha"
    assert law is not None
    axis = int(np.argmax(np.max(np.abs(law.signal), axis=0)))
    across = data.alpha_deg
    if against == "time" and data.time_s is not None:
        across = (data.time_s - data.time_s.min()) / 60
    elif against == "temperature" and data.temperature_degc is not None:
        across = data.temperature_degc
    elif against.startswith("u_"):
        across = diagnosis.screened.at.evaluation.inputs[:, AXES.index(against[2:])]
    panel.plot(across, 1e3 * own.excess.values[:, axis], "o", ms=3.2, color=AXIS_COLOUR[AXES[axis]], label="measured")
    panel.plot(across, 1e3 * _as_left(own, law)[:, axis], "x", ms=4, color=INK, label="law")
    panel.axhline(0, color=INK, lw=0.6)
    panel.set_title(law_words(law)[:44], fontsize=7)
    panel.set_xlabel(_VARIABLES.get(against, f"{against} / g"))
    panel.set_ylabel(f"{AXES[axis]} / mg")
    panel.legend(fontsize=6)


def _as_left(own: Unnamed, law: Law) -> Float[np.ndarray, "positions 3"]:
    """What the fit leaves of the law, whose parameters take up a part of it, g; in a region the law itself."""
    if own.excess.region:
        return law.signal
    fit = own.fit
    rows = np.zeros(len(fit.rows))
    rows[: law.signal.size] = fit.problem.rows(law.signal)
    left = rows - fit.column_space @ (fit.column_space.T @ rows)
    return fit.problem.unwhitened(left[: law.signal.size])
