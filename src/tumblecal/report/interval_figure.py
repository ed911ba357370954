"""The still intervals over the signal: the first answer to "why does my fit fail?"."""

import numpy as np
from matplotlib.figure import Figure

from tumblecal.recordings.still.stillness import Stillness
from tumblecal.report.drawing import AXIS_COLOUR, MUTED, OUTSIDE, new_figure


_MOST_POINTS, _MOST_NAMES = 4000, 60
_USED = "#d5ead8"


def interval_figure(stillness: Stillness, names: tuple[str, ...] = ()) -> Figure:
    """The accelerations with the intervals used (green), refused (red edge), and what each is called."""
    blocks = stillness.blocks
    step = max(1, len(blocks) // _MOST_POINTS)
    rows = slice(None, len(blocks) // step * step)
    figure = new_figure(9.0, 3.6)
    axes = figure.add_subplot()
    # A gap is no line.
    times = np.where(blocks.broken, np.nan, blocks.start_s)[rows].reshape(-1, step).mean(1)
    for column, (axis, colour) in enumerate(AXIS_COLOUR.items()):
        mean = blocks.mean[rows, column].reshape(-1, step).mean(1)
        axes.plot(times, mean, color=colour, linewidth=0.8, label=f"a{axis}")
    for interval in stillness.intervals:
        if interval.reason:
            axes.axvspan(interval.start_s, interval.stop_s, color=OUTSIDE, alpha=0.18, linewidth=0)
        else:
            axes.axvspan(interval.start_s, interval.stop_s, color=_USED, linewidth=0)
    top = axes.get_ylim()[1]
    names = names if len(names) <= _MOST_NAMES else ()
    for name, interval in zip(names, stillness.used, strict=False):
        middle = (interval.start_s + interval.stop_s) / 2
        axes.text(middle, top, name, rotation=90, fontsize=6, ha="center", va="bottom", color=MUTED)
    refused = sum(bool(interval.reason) for interval in stillness.intervals)
    axes.set_title(
        f"{len(stillness.used)} still intervals used (green), {refused} refused (red)", pad=26 if names else 6
    )
    axes.set_xlabel("time, s")
    axes.set_ylabel(f"acceleration, {blocks.unit.replace('ms2', 'm/s²')}")
    axes.legend(loc="upper right", ncols=3)
    return figure
