"""Figures of the evidence: posterior predictive check, and detection limits relative to the sizes met in practice."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.findings.residuals import Check, normal_quantiles
from tumblecal.estimation.fit import Fit
from tumblecal.ground.units import in_words
from tumblecal.show.figures.drawing import (
    AXIS_COLOUR,
    BAND,
    BLUE,
    INK,
    MUTED,
    OUTSIDE,
    WIDTH,
    Values,
    dots,
    marks,
    name_rows,
    new_rows,
    plain_log,
    with_legend,
)


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


def models_of(diagnosis: Diagnosis) -> dict[str, Fit]:
    """The nominal and the extended model, or the only one, with their fits."""
    if diagnosis.extended is diagnosis.nominal:
        return {"model": diagnosis.nominal}
    return {"nominal model": diagnosis.nominal, "extended model": diagnosis.extended}


def noise_of(diagnosis: Diagnosis) -> Float[np.ndarray, "3"]:
    """Standard deviation of the noise of each axis under the noise model in use, g."""
    return diagnosis.level / np.median(1.0 / diagnosis.problem.sd, axis=0)


def predictive_figure(diagnosis: Diagnosis) -> Figure:
    """Every statistic of the residuals within its simulated distribution, and normal quantile plots; before and after."""
    models = models_of(diagnosis)
    height = 0.4 * len(diagnosis.checks)
    figure = Figure(figsize=(WIDTH, height + 4.1), layout="constrained")
    parts: Any = figure.subfigures(2, 1, height_ratios=[height + 0.9, 3.2])
    _statistics(parts[0].subplots(), dict(zip(models, (diagnosis.checks, diagnosis.checks_after), strict=False)))
    with_legend(parts[0])
    panels = parts[1].subplots(1, len(models), squeeze=False)[0]
    for panel, (name, fit) in zip(panels, models.items(), strict=True):
        _quantiles(panel, fit, name)
    return figure


def _statistics(panel: Axes, found: Mapping[str, Sequence[Check]]) -> None:
    """A row for every statistic, scaled to its simulated range: 0 and 1 are the limits. Bars: 95 % and 50 % of the simulated
    values, with their median; dots: the measured values, those far beyond the limits at the edge."""
    looks = [(0.0, BLUE)] if len(found) == 1 else [(-0.2, MUTED), (0.2, BLUE)]
    for (name, checks), (shift, colour) in zip(found.items(), looks, strict=True):
        rows = np.arange(len(checks)) + shift
        low, high, *values = np.array([(check.low, check.high, check.value, *check.quantiles) for check in checks]).T
        at, lowest, lower, median, upper, highest = (np.array(values) - low) / np.maximum(high - low, 1e-300)
        panel.hlines(rows, lowest, highest, color=BAND, lw=7, label="simulated: 95 %")
        panel.hlines(rows, lower, upper, color="#cfcfcf", lw=7, label="50 %")
        panel.plot(median, rows, "|", color=INK, ms=7)
        outside = [check.outside for check in checks]
        dots(panel, np.clip(at, -_EDGE, 1 + _EDGE), rows, outside, colour, f"measured, {name} (red: outside)")
        for row, check in zip(rows, checks, strict=True):
            words = f"{check.value:.3g}   ({check.low:.3g} to {check.high:.3g}){'  outside' if check.outside else ''}"
            ink, place = OUTSIDE if check.outside else INK, panel.get_yaxis_transform()
            panel.text(1.02, row, words, transform=place, va="center", fontsize=7, color=ink)
        name_rows(panel, [WORDS.get(check.name, check.name) for check in checks])
    panel.set_xticks([0, 1], ["lower limit", "upper limit"])
    panel.set_xlim(-_EDGE - 0.05, 1 + _EDGE + 0.05)
    panel.set_title("Statistics of the residuals: measured (marks), and of data simulated from the fitted model (bars)")


def _quantiles(panel: Axes, fit: Fit, name: str) -> None:
    """Sorted residuals against normal quantiles, over the range of simulated data."""
    plot = normal_quantiles(fit)
    panel.fill_between(plot.normal, plot.low, plot.high, color=BAND, lw=0, label="99 % of simulated data")
    panel.plot(plot.normal, plot.middle, color=INK)
    dots(panel, plot.normal, plot.measured, plot.outside, BLUE, "measured")
    title = f"Residuals, {name}: {np.sum(plot.outside)} of {len(plot.outside)} outside"
    panel.set(title=title, xlabel="normal quantile", ylabel="residual / noise sd")
    panel.legend(loc="upper left")


def limits_figure(diagnosis: Diagnosis) -> Figure | None:
    """Detection limits divided by typical sizes, a row for each effect; None if no effect is detectable."""
    found = list(_relative_limits(diagnosis))
    limits = np.concatenate([np.zeros(0), *(sizes for *_, sizes in found)])
    if np.all(np.isnan(limits)):
        return None
    names = [*dict.fromkeys(name for name, *_ in found)]
    figure, panel = new_rows(names, 0.19, "detection limit / typical size (in brackets)")
    low, edge = 0.7 * np.nanmin([*limits, 0.5]), 3 * np.nanmax([*limits, 2.0])
    panel.axvspan(low, 1, color="#eef5ee", lw=0)
    panel.axvline(1, color=INK, lw=0.9)
    for name, axis, sizes in found:
        colour, shift = AXIS_COLOUR.get(axis, INK), {"x": -0.24, "z": 0.24}.get(axis, 0.0)
        row, hidden = np.full(len(sizes), names.index(name) + shift), np.isnan(sizes)
        panel.plot(sizes, row, "o-", color=colour, lw=0.8, label=f"axis {axis}" if axis else "head, all axes")
        marks(panel, edge + 0 * row[hidden], row[hidden], colour, "undetectable at any size", marker="x")
    panel.set(xscale="log", xlim=(low, 1.3 * edge))
    plain_log(panel.xaxis)
    return with_legend(figure, 5)


def _relative_limits(diagnosis: Diagnosis) -> Iterator[tuple[str, str, Values]]:
    """Each effect in the order of the catalogue: its name without the axis and its typical size, the axis ("": none), sorted
    limits relative to that size, NaN for an undetectable coefficient."""
    for id, entry in diagnosis.entries.items():
        limit = diagnosis.limits.get(id)
        if entry.typical > 0 and (limit is not None or id in diagnosis.invisible):
            name, *parts = id.split(".")
            axis = parts.pop(0) if parts and parts[0] in AXIS_COLOUR else ""
            sizes = [None] if limit is None else [*limit.coefficients.values()]
            words = f"{' '.join([name, *parts])}  ({in_words(entry.typical, entry.unit)})"
            yield words, axis, np.sort(np.array(sizes, float)) / entry.typical
