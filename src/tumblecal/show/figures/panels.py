"""Parts that many figures share: marks, bands, rows with names, ticks, the legend."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter
from numpy.typing import ArrayLike

from tumblecal.show.figures.drawing import BAND, INK, MUTED, OUTSIDE, new_panel


Values = Float[np.ndarray, " positions"]
OfAxes = Float[np.ndarray, "positions 3"]
Shown = Bool[np.ndarray, " positions"]


def marks(
    panel: Axes,
    across: ArrayLike,
    values: ArrayLike,
    colour: str,
    words: str | None = None,
    *,
    marker: str = "o",
    ring: bool = False,
) -> None:
    """Dots, or rings; `words`: in the legend. Without values only the legend has them."""
    panel.plot(across, values, marker, color=colour, mfc="none" if ring else colour, mew=0.8, ls="none", label=words)


def dots(panel: Axes, across: ArrayLike, values: ArrayLike, outside: ArrayLike, colour: str, words: str = "") -> None:
    """Dots; those outside a range are red."""
    panel.scatter(across, values, s=18, c=np.where(outside, OUTSIDE, colour), label=words, zorder=3)


def noise_band(panel: Axes, half: float, words: str | None = None, middle: float = 0.0) -> None:
    """A line, and a band about it."""
    panel.axhspan(middle - half, middle + half, color=BAND, lw=0, zorder=0, label=words)
    panel.axhline(middle, color=INK, lw=0.7)


def limit(panel: Axes, value: float) -> None:
    """The value that is expected or allowed."""
    panel.axhline(value, color=MUTED, lw=0.8)


def name_rows(panel: Axes, names: Sequence[str]) -> None:
    """A row for each name, the first above."""
    panel.set_yticks(range(len(names)), names)
    panel.set_ylim(len(names) - 0.5, -0.5)
    panel.tick_params(axis="y", length=0)
    panel.grid(axis="y", visible=False)


def new_rows(names: Sequence[str], each: float, xlabel: str) -> tuple[Figure, Axes]:
    """A figure with a row for each name, of a height in inches."""
    figure, panel = new_panel(each * len(names) + 1.1, xlabel=xlabel)
    name_rows(panel, names)
    return figure, panel


def plain_log(axis: Axis) -> None:
    """Ticks of a logarithmic axis as plain numbers, also if it is shorter than a decade."""
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 100 * low else (1,), numticks=9))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def angle_ticks(axis: Axis) -> None:
    """Ticks of an angle, every 90 degrees for a turn."""
    axis.set_major_locator(MaxNLocator(4, steps=[1, 1.8, 4.5, 9, 10]))


def with_legend(figure: Figure, columns: int = 4, place: str = "outside upper left") -> Figure:
    """The figure with the words of all panels, each once, above them or at another place."""
    handles = {}
    for panel in figure.axes:
        for handle, words in zip(*panel.get_legend_handles_labels(), strict=True):
            handles.setdefault(words, handle)
    figure.legend(handles.values(), handles, loc=place, ncols=columns)  # pyright: ignore[reportArgumentType]
    return figure
