"""Figures of a check: size of gravity at each attitude, and detection limits."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.check.result import CheckResult
from tumblecal.check.usual_changes import USUAL
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.report.drawing import BAND, INK, MUTED, OUTSIDE, new_figure


# Names on the axis, at most, and their letters in one line.
_MOST_NAMES, _ROOM = 16, 26


def check_figure(result: CheckResult) -> Figure:
    """Size of gravity and detection limits in one figure."""
    figure = new_figure(6.2, 3.3)
    sizes, limits = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    _draw_sizes(sizes, result)
    _draw_limits(limits, result)
    return figure


def size_figure(result: CheckResult) -> Figure:
    """Size of gravity at each attitude."""
    figure = new_figure(4.0, 2.6)
    _draw_sizes(figure.subplots(), result)
    return figure


def limit_figure(result: CheckResult) -> Figure:
    """Detection limits over the usual changes."""
    figure = new_figure(4.0, 2.6)
    _draw_limits(figure.subplots(), result)
    return figure


def _draw_sizes(axes: Axes, result: CheckResult) -> None:
    """Deviations from the expected size, with the range without a change."""
    excess, u = result.sizes.excess * 1e3, result.sizes.sd * 1e3
    at = np.arange(len(excess))
    axes.bar(at, 4 * u, bottom=-2 * u, color=BAND, width=0.8, zorder=1)
    far = np.abs(excess) > 2 * u
    axes.plot(at[~far], excess[~far], "o", color=INK, markersize=4)
    axes.plot(at[far], excess[far], "o", color=OUTSIDE, markersize=5)
    axes.axhline(0, color=MUTED, linewidth=0.8)
    axes.grid(axis="x", visible=False)
    if len(at) <= _MOST_NAMES:
        longest = max(map(len, result.data.names))
        axes.set_xticks(at, result.data.names, rotation=90 if longest * len(at) > _ROOM else 0)
    axes.set_ylabel("size of gravity, deviation / mg")
    axes.set_title("band: 95 % without a change")


def _draw_limits(axes: Axes, result: CheckResult) -> None:
    """A bar for each parameter, over its usual change."""
    seen = result.sensitivity.limits / USUAL
    finite = np.isfinite(seen)
    rows = np.arange(len(SENSOR))[::-1]
    axes.barh(rows[finite], seen[finite], color="#b9d3ea")
    for row, there in zip(rows, finite, strict=True):
        if not there:
            axes.text(0.03, row, "not visible", va="center", color=OUTSIDE, transform=axes.get_yaxis_transform())
    axes.axvline(1.0, color=MUTED, linewidth=0.8)
    axes.set_yticks(rows, SENSOR)
    axes.set_xscale("log")
    axes.set_xlim(0.01, 100)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("smallest detected change / usual change")
    axes.set_title("usual: 1.5 mg, 0.5e-3, 2 mrad")
