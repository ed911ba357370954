"""Figures of a check: size of gravity at each attitude, and detection limits."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tumblecal.check.result import CheckResult
from tumblecal.check.usual_changes import USUAL
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.show.figures.drawing import BAND, INK, MUTED, OUTSIDE, Figures, dots, name_rows, new_panels


# Names on the axis, at most.
_MOST_NAMES = 17


def check_figure(result: CheckResult, parts: Sequence[Callable[[Axes, CheckResult], None]]) -> Figure:
    """Parts of a check, `sizes` and `limits`, a panel each."""
    figure, panels = new_panels(2.6, 1, len(parts), 0.8 + 2.9 * len(parts))
    for panel, draw in zip(panels[0], parts, strict=True):
        draw(panel, result)
    return figure


def sizes(panel: Axes, result: CheckResult) -> None:
    """Deviations from the expected size, with the range without a change."""
    excess, u, names = result.sizes.excess * 1e3, result.sizes.sd * 1e3, result.data.names
    place = np.arange(len(excess))
    panel.bar(place, 4 * u, bottom=-2 * u, color=BAND)
    dots(panel, place, excess, np.abs(excess) > 2 * u, INK)
    panel.axhline(0, color=MUTED, lw=0.8)
    panel.grid(axis="x", visible=False)
    some = slice(None, None, 1 + len(names) // _MOST_NAMES)
    panel.set_xticks(place[some], names[some], rotation=90)
    panel.set(ylabel="size of gravity, deviation / mg", title="band: 95 % without a change")


def limits(panel: Axes, result: CheckResult) -> None:
    """A bar for each parameter, over its usual change."""
    relative = result.sensitivity.limits / USUAL
    rows, seen = np.arange(len(SENSOR)), np.isfinite(relative)
    panel.barh(rows[seen], relative[seen], color="#b9d3ea")
    for row in rows[~seen]:
        panel.text(0.03, row, "not visible", va="center", color=OUTSIDE, transform=panel.get_yaxis_transform())
    panel.axvline(1.0, color=MUTED, lw=0.8)
    name_rows(panel, SENSOR)
    panel.set(xscale="log", xlim=(0.01, 100))
    panel.set(xlabel="smallest detected change / usual change", title="usual: 1.5 mg, 0.5e-3, 2 mrad")


FIGURES: Figures = {
    "check": partial(check_figure, parts=(sizes, limits)),
    "sizes": partial(check_figure, parts=(sizes,)),
    "limits": partial(check_figure, parts=(limits,)),
}
