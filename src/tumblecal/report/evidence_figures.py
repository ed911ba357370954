"""Figures of the evidence: posterior predictive check, and detection limits relative to the sizes met in practice."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.findings.residuals import Check, normal_quantiles
from tumblecal.estimation.fit import Fit
from tumblecal.ground.units import in_words
from tumblecal.report.drawing import AXIS_COLOUR, BAND, INK, MUTED, OUTSIDE, new_figure


# Names of the statistics on the figure.
WORDS = {
    "largest over rms": "largest residual / rms",
    "kurtosis": "kurtosis (normal: about 3)",
    "correlation of neighbours": "correlation of neighbouring positions",
    "largest position": "share of the largest position",
    "sum of squares": "sum of squares / noise variance",
}
# Values beyond this part of the simulated range are arrows at the edge.
_EDGE = 0.35
_BEFORE, _AFTER = "nominal model", "extended model"


def predictive_figure(diagnosis: Diagnosis) -> Figure:
    """Every statistic of the residuals within its simulated distribution, and normal quantile plots; before and after."""
    inserted = diagnosis.extended is not diagnosis.nominal
    height = (0.40 if inserted else 0.27) * len(diagnosis.checks)
    figure = new_figure(7.5, height + 4.1)
    parts: Any = figure.subfigures(2, 1, height_ratios=[height + 0.9, 3.2])
    upper, lower = parts
    _statistics(upper.subplots(), diagnosis, inserted)
    fits = [(_BEFORE, diagnosis.nominal), (_AFTER, diagnosis.extended)] if inserted else [("model", diagnosis.nominal)]
    panels = lower.subplots(1, 2, squeeze=False)[0]
    for panel, (name, fit) in zip(panels, fits, strict=False):
        _quantiles(panel, diagnosis, fit, name)
    if not inserted:
        _histogram(panels[1], diagnosis)
    return figure


def _statistics(panel: Axes, diagnosis: Diagnosis, inserted: bool) -> None:
    """A row for every statistic, scaled to its simulated range: 0 and 1 are the limits."""
    pairs = list(zip(diagnosis.checks, diagnosis.checks_after, strict=True))
    for row, (before, after) in enumerate(pairs):
        if inserted:
            _strip(panel, row - 0.2, before, MUTED, hollow=True)
            _strip(panel, row + 0.2, after, AXIS_COLOUR["x"], hollow=False)
        else:
            _strip(panel, row, before, AXIS_COLOUR["x"], hollow=False)
    panel.set_yticks(range(len(pairs)), [WORDS.get(before.name, before.name) for before, _ in pairs])
    panel.set_ylim(len(pairs) - 0.5, -0.5)
    panel.set_xlim(-_EDGE - 0.05, 1 + _EDGE + 0.05)
    panel.set_xticks([0, 1], ["lower limit", "upper limit"])
    panel.grid(axis="y", visible=False)
    panel.spines["left"].set_visible(False)
    panel.tick_params(axis="y", length=0)
    panel.set_title("Statistics of the residuals: measured (marks), and of data simulated from the fitted model (bars)")
    _key(panel, inserted)


def _strip(panel: Axes, height: float, check: Check, colour: str, *, hollow: bool) -> None:
    """One statistic: 95 % and 50 % of the simulated values as bars, their median, and the measured value."""
    width = max(check.high - check.low, 1e-300)
    part = [(value - check.low) / width for value in check.quantiles]
    size = 0.13
    panel.plot([0, 1], [height, height], color=BAND, lw=1, zorder=1)
    panel.barh(height, part[-1] - part[0], 2 * size, part[0], color=BAND, zorder=1)
    panel.barh(height, part[-2] - part[1], 2 * size, part[1], color="#cfcfcf", zorder=1.1)
    panel.plot([part[2]] * 2, [height - size, height + size], color=INK, lw=0.8, zorder=1.2)
    at = (check.value - check.low) / width
    marker = "<" if at < -_EDGE else ">" if at > 1 + _EDGE else "o"
    ink = OUTSIDE if check.outside else colour
    at, face = np.clip(at, -_EDGE, 1 + _EDGE), "white" if hollow else ink
    panel.plot(at, height, marker, ms=6, color=ink, mfc=face, zorder=3)
    words = f"{check.value:.3g}   ({check.low:.3g} to {check.high:.3g})"
    look: dict[str, Any] = {"color": ink, "fontweight": "bold"} if check.outside else {"color": INK}
    words += "  outside" if check.outside else ""
    panel.text(1.02, height, words, transform=panel.get_yaxis_transform(), va="center", fontsize=7, **look)


def _key(panel: Axes, inserted: bool) -> None:
    marks = [(_BEFORE, MUTED, "white"), (_AFTER, AXIS_COLOUR["x"], AXIS_COLOUR["x"])]
    handles = [
        *(
            panel.plot([], [], "o", ms=6, color=edge, mfc=face, ls="none", label=name)[0]
            for name, edge, face in (marks if inserted else [("measured", *marks[1][1:])])
        ),
        panel.plot([], [], "o", ms=6, color=OUTSIDE, ls="none", label="outside the limits")[0],
        panel.barh(0, 0, color="#cfcfcf", label="simulated: 50 %"),
        panel.barh(0, 0, color=BAND, label="95 %"),
    ]
    panel.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.09), ncols=5, fontsize=7)


def _quantiles(panel: Axes, diagnosis: Diagnosis, fit: Fit, name: str) -> None:
    """Sorted residuals against normal quantiles, over the range of simulated data."""
    plot = normal_quantiles(fit)
    outside = plot.outside
    panel.fill_between(plot.normal, plot.low, plot.high, color=BAND, lw=0, label="99 % of simulated data")
    panel.plot(plot.normal, plot.middle, color=INK, lw=0.8)
    panel.plot(plot.normal[~outside], plot.measured[~outside], "o", ms=3, color=AXIS_COLOUR["x"], label="measured")
    if np.any(outside):
        words = f"measured, outside ({np.sum(outside)} of {len(outside)})"
        panel.plot(plot.normal[outside], plot.measured[outside], "o", ms=3, color=OUTSIDE, label=words)
    panel.set_title(f"Residuals of the {name}")
    panel.set_xlabel("normal quantile")
    panel.set_ylabel("residual / noise sd")
    panel.legend(loc="upper left", fontsize=7)


def _histogram(panel: Axes, diagnosis: Diagnosis) -> None:
    """Histogram of the residuals and the mean of simulated ones (if there is no second model)."""
    plot = normal_quantiles(diagnosis.nominal)
    reach = 1.05 * max(np.max(np.abs(plot.measured)), np.max(np.abs(plot.high)))
    bins = np.linspace(-reach, reach, 16)
    panel.hist(plot.measured, bins, color=AXIS_COLOUR["x"], alpha=0.75, label="measured")
    panel.hist(plot.middle, bins, histtype="step", color=INK, lw=0.9, label="expected")
    panel.set_axisbelow(True)
    panel.set_title("Distribution of the residuals")
    panel.set_xlabel("residual / noise sd")
    panel.set_ylabel("readings")
    panel.legend(loc="upper left", fontsize=7)


@dataclass
class _Row:
    """Effects that differ only in the axis: typical size, and the limits of each axis ("" if there is none)."""

    unit: str
    typical: float
    limits: dict[str, list[float | None]] = field(default_factory=dict)


def limits_figure(diagnosis: Diagnosis) -> Figure | None:
    """Detection limits divided by typical sizes, a row for each effect; None if no effect is detectable."""
    rows = _rows(diagnosis)
    sizes = [
        limit for row in rows.values() for of_axis in row.limits.values() for limit in of_axis if limit is not None
    ]
    if not sizes:
        return None
    figure = new_figure(7.5, 0.19 * len(rows) + 1.1)
    panel = figure.subplots()
    low, high = 10 ** np.floor(np.log10(min(*sizes, 0.5))), 10 ** np.ceil(np.log10(max(*sizes, 2.0)))
    edge = high * 10 ** (0.13 * np.log10(high / low))
    panel.axvspan(low, 1, color="#eef5ee", lw=0)
    panel.axvline(1, color=INK, lw=0.9)
    panel.axvline(high, color="#cccccc", lw=0.6)
    for line, row in enumerate(rows.values()):
        for axis, of_axis in row.limits.items():
            _marks(panel, line, axis, of_axis, edge)
    panel.set_xscale("log")
    panel.set_xlim(low, edge * (edge / high) ** 0.6)
    panel.set_ylim(len(rows) - 0.4, -0.6)
    panel.set_yticks(range(len(rows)), [f"{name}  ({in_words(row.typical, row.unit)})" for name, row in rows.items()])
    panel.tick_params(axis="y", labelsize=7, length=0)
    panel.set_xlabel("detection limit / typical size (in brackets)")
    decades = 10.0 ** np.arange(np.log10(low), np.log10(high) + 0.5)
    panel.set_xticks([*decades, edge], [*(f"{size:g}" for size in decades), "unde-\ntectable"])
    panel.minorticks_off()
    panel.set_axisbelow(True)
    marks = [*((f"axis {axis}", "o", colour) for axis, colour in AXIS_COLOUR.items()), ("head, all axes", "o", INK)]
    for words, mark, colour in [*marks, ("undetectable at any size", "x", MUTED)]:
        panel.plot([], [], mark, ms=4, color=colour, ls="none", label=words)
    panel.legend(loc="lower center", bbox_to_anchor=(0.4, 1.0), ncols=5, fontsize=7)
    return figure


def _rows(diagnosis: Diagnosis) -> dict[str, _Row]:
    """Rows in the order of the catalogue; an undetectable coefficient is None."""
    rows: dict[str, _Row] = {}
    for id, entry in diagnosis.entries.items():
        limit, hidden = diagnosis.limits.get(id), diagnosis.invisible.get(id)
        if entry.typical <= 0 or (limit is None and hidden is None):
            continue
        family, axis = _family(id)
        row = rows.setdefault(family, _Row(entry.unit, entry.typical))
        sizes = list(limit.coefficients.values()) if limit is not None else [None]
        row.limits[axis] = [None if size is None else size / entry.typical for size in sizes]
    return rows


def _family(id: str) -> tuple[str, str]:
    """`second_order.x` -> `second_order`, `x`; `cross_coupling.x.yz` -> `cross_coupling yz`, `x`."""
    name, *parts = id.split(".")
    axis = parts[0] if parts and parts[0] in AXIS_COLOUR else ""
    return " ".join([name, *(parts[1:] if axis else parts)]), axis


def _marks(panel: Axes, line: int, axis: str, limits: list[float | None], edge: float) -> None:
    """The limits of one axis as dots, joined if there are several; undetectable ones are drawn beyond the scale."""
    colour = AXIS_COLOUR.get(axis, INK)
    height = line + {"x": -0.24, "y": 0.0, "z": 0.24}.get(axis, 0.0)
    seen = [size for size in limits if size is not None]
    if seen:
        panel.plot([min(seen), max(seen)], [height] * 2, color=colour, lw=0.8)
        panel.plot(seen, [height] * len(seen), "o", ms=3.6, color=colour)
    if len(seen) < len(limits):
        panel.plot(edge, height, "x", ms=3.6, mew=1, color=MUTED if not axis else colour, alpha=0.7)
