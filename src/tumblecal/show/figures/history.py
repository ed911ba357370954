"""Control charts of a unit: one figure for each kind of parameter."""

from collections.abc import Sequence
from functools import partial

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.data.sensor_parameters import GROUPS, leaf_of
from tumblecal.ground.units import shown
from tumblecal.history.repeatability import Trend, UnitHistory
from tumblecal.show.figures.drawing import BAND, INK, MUTED, Figures, dots, new_panels


def chart_figure(leaf: str, history: UnitHistory) -> Figure | None:
    """The control charts of one kind of parameter; None if there are none."""
    trends = [trend for trend in history.trends if leaf_of(trend.name) == leaf]
    if not trends:
        return None
    figure, panels = new_panels(1.5 * len(trends) + 0.6, len(trends), sharex=True)
    times = [entry.when for entry in history.entries]
    dated = len(set(times)) == len(times)
    for panel, trend in zip(panels[:, 0], trends, strict=True):
        _draw(panel, times if dated else range(1, len(times) + 1), trend)
    last = panels[-1, 0]
    last.set_xlabel("date" if dated else "result")
    if not dated:
        last.locator_params(axis="x", integer=True)
    return figure


def _draw(panel: Axes, across: Sequence, trend: Trend) -> None:
    """Results with their expanded uncertainty, the fitted line, and the control limits, if there are any."""
    unit, factor = shown(trend.unit)
    values, mean, half = factor * trend.values, factor * trend.mean, factor * trend.control
    if half > 0:
        panel.axhspan(mean - half, mean + half, color=BAND, lw=0, zorder=0)
    panel.plot(across, factor * trend.fitted, color=MUTED, lw=0.8)
    panel.errorbar(across, values, factor * trend.expanded, fmt="none", ecolor=INK, elinewidth=0.8)
    dots(panel, across, values, trend.outside, INK)
    panel.set_ylabel(f"{trend.name} / {unit}".replace("@", "\n@"))


FIGURES: Figures = {f"history_{leaf}.svg": partial(chart_figure, leaf) for leaf in GROUPS}
