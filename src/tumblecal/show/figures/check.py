"""Figures of a check: size of gravity at each attitude, and detection limits."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.check.result import CheckResult
from tumblecal.check.usual_changes import USUAL
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.show.figures.drawing import BAND, INK, MUTED, OUTSIDE, new_panel, new_panels
from tumblecal.show.figures.panels import marks, name_rows


# Names on the axis, at most.
_MOST_NAMES = 17


def check_figure(result: CheckResult) -> Figure:
    """Size of gravity and detection limits in one figure."""
    figure, panels = new_panels(3.3, 1, 2, 6.2, width_ratios=(1.25, 1.0))
    _draw_sizes(panels[0, 0], result)
    _draw_limits(panels[0, 1], result)
    return figure


def size_figure(result: CheckResult) -> Figure:
    """Size of gravity at each attitude."""
    figure, panel = new_panel(2.6, 4.0)
    _draw_sizes(panel, result)
    return figure


def limit_figure(result: CheckResult) -> Figure:
    """Detection limits over the usual changes."""
    figure, panel = new_panel(2.6, 4.0)
    _draw_limits(panel, result)
    return figure


def _draw_sizes(panel: Axes, result: CheckResult) -> None:
    """Deviations from the expected size, with the range without a change."""
    excess, u, names = result.sizes.excess * 1e3, result.sizes.sd * 1e3, result.data.names
    place, far = np.arange(len(excess)), np.abs(excess) > 2 * u
    panel.bar(place, 4 * u, bottom=-2 * u, color=BAND)
    for here, colour in ((~far, INK), (far, OUTSIDE)):
        marks(panel, place[here], excess[here], colour)
    panel.axhline(0, color=MUTED, lw=0.8)
    panel.grid(axis="x", visible=False)
    some = slice(None, None, 1 + len(names) // _MOST_NAMES)
    panel.set_xticks(place[some], names[some], rotation=90)
    panel.set(ylabel="size of gravity, deviation / mg", title="band: 95 % without a change")


def _draw_limits(panel: Axes, result: CheckResult) -> None:
    """A bar for each parameter, over its usual change."""
    limits = result.sensitivity.limits / USUAL
    rows, seen = np.arange(len(SENSOR)), np.isfinite(limits)
    panel.barh(rows[seen], limits[seen], color="#b9d3ea")
    for row in rows[~seen]:
        panel.text(0.03, row, "not visible", va="center", color=OUTSIDE, transform=panel.get_yaxis_transform())
    panel.axvline(1.0, color=MUTED, lw=0.8)
    name_rows(panel, SENSOR)
    panel.set(xscale="log", xlim=(0.01, 100))
    panel.set(xlabel="smallest detected change / usual change", title="usual: 1.5 mg, 0.5e-3, 2 mrad")
