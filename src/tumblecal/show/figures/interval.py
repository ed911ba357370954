"""The still intervals over the signal: the first answer to "why does my fit fail?"."""

import numpy as np
from matplotlib.figure import Figure

from tumblecal.recordings.still.stillness import Stillness
from tumblecal.show.figures.drawing import AXIS_COLOUR, MUTED, OUTSIDE, Figures, new_panel


_MOST_POINTS, _MOST_NAMES = 4000, 60


def interval_figure(stillness: Stillness, names: tuple[str, ...] = ()) -> Figure:
    """The accelerations with the intervals used (green), refused (red), and the name of each."""
    blocks, used = stillness.blocks, stillness.used
    unit = blocks.unit.replace("ms2", "m/s²")
    figure, panel = new_panel(3.6, 9.0, xlabel="time, s", ylabel=f"acceleration, {unit}")
    # A gap is no line; a long recording is drawn by means of several blocks.
    times = np.where(blocks.broken, np.nan, blocks.start_s)
    step = max(1, len(blocks) // _MOST_POINTS)
    points = np.column_stack([times, blocks.mean[:, :3]])[: len(blocks) // step * step]
    points = points.reshape(-1, step, 4).mean(axis=1)
    for column, (axis, colour) in enumerate(AXIS_COLOUR.items(), 1):
        panel.plot(points[:, 0], points[:, column], color=colour, lw=0.8, label=f"a{axis}")
    for interval in stillness.intervals:
        colour = OUTSIDE if interval.reason else "#2ca02c"
        panel.axvspan(interval.start_s, interval.stop_s, color=colour, alpha=0.18, lw=0)
    if len(names) <= _MOST_NAMES:
        middles = [(interval.start_s + interval.stop_s) / 2 for interval in used]
        panel.secondary_xaxis("top").set_xticks(middles[: len(names)], names, rotation=90, fontsize=6, color=MUTED)
    refused = len(stillness.intervals) - len(used)
    panel.set_title(f"{len(used)} still intervals used (green), {refused} refused (red)")
    panel.legend(loc="upper right", ncols=3)
    return figure


FIGURES: Figures = {"intervals.svg": interval_figure}
