"""The control charts of a unit."""

from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from tumblecal.data.sensor_parameters import GROUPS, leaf_of
from tumblecal.ground.units import shown
from tumblecal.history.repeatability import Trend, UnitHistory
from tumblecal.report.drawing import BAND, INK, MUTED, OUTSIDE, draw_each, new_figure, save


_MOST_DATES = 8


def draw_charts(folder: Path, history: UnitHistory) -> list[str]:
    """Draw the control charts; returns the names of those drawn."""
    leaves = [leaf for leaf in GROUPS if any(leaf_of(trend.name) == leaf for trend in history.trends)]
    return [*draw_each(folder, {f"history_{leaf}.svg": partial(_chart, leaf, history) for leaf in leaves}, save)]


def _chart(leaf: str, history: UnitHistory) -> Figure:
    """The control charts of one kind of parameter."""
    trends = [trend for trend in history.trends if leaf_of(trend.name) == leaf]
    figure = new_figure(7.5, 1.5 * len(trends) + 0.6)
    panels = figure.subplots(len(trends), 1, sharex=True, squeeze=False)[:, 0]
    times = [entry.when for entry in history.entries]
    dated = len(set(times)) == len(times)
    across = times if dated else list(range(1, len(times) + 1))
    for panel, trend in zip(panels, trends, strict=True):
        _draw(panel, across, trend)
    panels[-1].set_xlabel("date" if dated else "result")
    if dated:
        # Few dates, with their common part written once, so that they do not overlap.
        locator = AutoDateLocator(minticks=3, maxticks=_MOST_DATES)
        panels[-1].xaxis.set_major_locator(locator)
        panels[-1].xaxis.set_major_formatter(ConciseDateFormatter(locator))
    else:
        panels[-1].locator_params(axis="x", integer=True)
    return figure


def _draw(panel, across: list, trend: Trend) -> None:
    unit, factor = shown(trend.unit)
    values, mean = trend.values * factor, trend.mean * factor
    if trend.control > 0:
        panel.axhspan(mean - trend.control * factor, mean + trend.control * factor, color=BAND, zorder=0)
    panel.plot(across, trend.fitted * factor, color=MUTED, lw=0.8)
    panel.errorbar(across, values, yerr=trend.expanded * factor, fmt="o", ms=4, color=INK, elinewidth=0.8)
    red = np.flatnonzero(trend.outside)
    panel.plot([across[k] for k in red], values[red], "o", ms=6, color=OUTSIDE)
    panel.set_ylabel(f"{trend.name} / {unit}".replace("@", "\n@"))
