"""Figures of the evidence: posterior predictive check, and detection limits relative to the sizes met in practice."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.findings.residuals import Check, normal_quantiles
from tumblecal.estimation.fit import Fit
from tumblecal.ground.units import in_words
from tumblecal.show.figures.drawing import AXIS_COLOUR, BAND, BLUE, INK, MUTED, OUTSIDE, WIDTH, new_panel
from tumblecal.show.figures.panels import curve, marks, name_rows, plain_log, with_legend


# Names of the statistics on the figure.
WORDS = {
    "largest over rms": "largest residual / rms",
    "kurtosis": "kurtosis (normal: about 3)",
    "correlation of neighbours": "correlation of neighbouring positions",
    "largest position": "share of the largest position",
    "sum of squares": "sum of squares / noise variance",
}
# Marks end at this part of the simulated range beyond its limits.
_EDGE = 0.35
# Colour, words and place in a row of an axis; "": effects of the head.
_OF_AXIS = {
    axis: (colour, f"axis {axis}", shift)
    for (axis, colour), shift in zip(AXIS_COLOUR.items(), (-0.24, 0.0, 0.24), strict=True)
} | {"": (INK, "head, all axes", 0.0)}


def models_of(diagnosis: Diagnosis) -> dict[str, Fit]:
    """The nominal and the extended model, or the only one, with their fits."""
    if diagnosis.extended is diagnosis.nominal:
        return {"model": diagnosis.nominal}
    return {"nominal model": diagnosis.nominal, "extended model": diagnosis.extended}


def predictive_figure(diagnosis: Diagnosis) -> Figure:
    """Every statistic of the residuals within its simulated distribution, and normal quantile plots; before and after."""
    models = models_of(diagnosis)
    height = (0.14 + 0.13 * len(models)) * len(diagnosis.checks)
    figure = Figure(figsize=(WIDTH, height + 4.1), layout="constrained")
    parts: Any = figure.subfigures(2, 1, height_ratios=[height + 0.9, 3.2])
    _statistics(parts[0].subplots(), dict(zip(models, (diagnosis.checks, diagnosis.checks_after), strict=False)))
    with_legend(parts[0], 5)
    panels = parts[1].subplots(1, len(models), squeeze=False)[0]
    for panel, (name, fit) in zip(panels, models.items(), strict=True):
        _quantiles(panel, fit, name)
    return figure


def _statistics(panel: Axes, found: Mapping[str, Sequence[Check]]) -> None:
    """A row for every statistic, scaled to its simulated range: 0 and 1 are the limits."""
    looks = [(0.0, BLUE, False)] if len(found) == 1 else [(-0.2, MUTED, True), (0.2, BLUE, False)]
    for (name, checks), (shift, colour, ring) in zip(found.items(), looks, strict=True):
        for row, check in enumerate(checks):
            look = (OUTSIDE, "outside the limits") if check.outside else (colour, f"measured, {name}")
            _strip(panel, row + shift, check, *look, ring)
        name_rows(panel, [WORDS.get(check.name, check.name) for check in checks])
    panel.set_xticks([0, 1], ["lower limit", "upper limit"])
    panel.set_xlim(-_EDGE - 0.05, 1 + _EDGE + 0.05)
    panel.spines["left"].set_visible(False)
    panel.set_title("Statistics of the residuals: measured (marks), and of data simulated from the fitted model (bars)")


def _strip(panel: Axes, height: float, check: Check, colour: str, name: str, ring: bool) -> None:
    """One statistic: 95 % and 50 % of the simulated values as bars, their median, and the measured value, which is at the edge
    if it is far beyond the limits."""
    span = max(check.high - check.low, 1e-300)
    at, lowest, low, middle, high, highest = ((value - check.low) / span for value in (check.value, *check.quantiles))
    panel.hlines(height, lowest, highest, color=BAND, lw=7, label="simulated: 95 %")
    panel.hlines(height, low, high, color="#cfcfcf", lw=7, label="50 %")
    panel.plot(middle, height, "|", color=INK, ms=7)
    face = "white" if ring else colour
    panel.plot(np.clip(at, -_EDGE, 1 + _EDGE), height, "o", ms=6, color=colour, mfc=face, ls="none", label=name)
    words = f"{check.value:.3g}   ({check.low:.3g} to {check.high:.3g}){'  outside' if check.outside else ''}"
    panel.text(
        1.02,
        height,
        words,
        transform=panel.get_yaxis_transform(),
        va="center",
        fontsize=7,
        color=OUTSIDE if check.outside else INK,
    )


def _quantiles(panel: Axes, fit: Fit, name: str) -> None:
    """Sorted residuals against normal quantiles, over the range of simulated data."""
    plot = normal_quantiles(fit)
    outside = plot.outside
    curve(panel, plot.normal, plot.low, plot.middle, plot.high, words="99 % of simulated data")
    marks(panel, plot.normal[~outside], plot.measured[~outside], BLUE, "measured")
    if np.any(outside):
        words = f"measured, outside ({np.sum(outside)} of {len(outside)})"
        marks(panel, plot.normal[outside], plot.measured[outside], OUTSIDE, words)
    panel.set(title=f"Residuals of the {name}", xlabel="normal quantile", ylabel="residual / noise sd")
    panel.legend(loc="upper left")


def limits_figure(diagnosis: Diagnosis) -> Figure | None:
    """Detection limits divided by typical sizes, a row for each effect; None if no effect is detectable."""
    rows = _limits_by_effect(diagnosis)
    limits = np.array([size for row in rows.values() for sizes in row.values() for size in sizes])
    if not np.any(np.isfinite(limits)):
        return None
    figure, panel = new_panel(0.19 * len(rows) + 1.1)
    low, edge = 0.7 * np.nanmin([*limits, 0.5]), 3 * np.nanmax([*limits, 2.0])
    panel.axvspan(low, 1, color="#eef5ee", lw=0)
    panel.axvline(1, color=INK, lw=0.9)
    for line, row in enumerate(rows.values()):
        for axis, sizes in row.items():
            colour, words, shift = _OF_AXIS[axis]
            height, hidden = np.full(len(sizes), line + shift), np.isnan(sizes)
            panel.plot(sizes, height, "o-", color=colour, lw=0.8, label=words)
            marks(panel, edge + 0 * height[hidden], height[hidden], colour, "undetectable at any size", marker="x")
    name_rows(panel, list(rows), size=7)
    panel.set(xscale="log", xlim=(low, 1.3 * edge), xlabel="detection limit / typical size (in brackets)")
    plain_log(panel.xaxis)
    return with_legend(figure, 5)


def _limits_by_effect(diagnosis: Diagnosis) -> dict[str, dict[str, Float[np.ndarray, " coefficients"]]]:
    """Effects that differ only in the axis in one row, in the order of the catalogue: sorted limits of each axis ("": none),
    NaN for an undetectable coefficient."""
    rows = {}
    for id, entry in diagnosis.entries.items():
        limit = diagnosis.limits.get(id)
        if entry.typical > 0 and (limit is not None or id in diagnosis.invisible):
            name, *parts = id.split(".")
            axis = parts.pop(0) if parts and parts[0] in AXIS_COLOUR else ""
            words = f"{' '.join([name, *parts])}  ({in_words(entry.typical, entry.unit)})"
            sizes = [None] if limit is None else [*limit.coefficients.values()]
            rows.setdefault(words, {})[axis] = np.sort(np.array(sizes, float)) / entry.typical
    return rows
