"""Style of all figures, the parts that many share, and drawing them: as SVG, without a display, reproducible to the bit."""

import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from cycler import cycler
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike


matplotlib.use("Agg")

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from tumblecal.ground.atomic import write_text
from tumblecal.ground.result_set import supplement


# Colours that colour-blind readers distinguish, also in grey (Okabe and Ito 2008).
INK = "#222222"
MUTED = "#9a9a9a"
BAND = "#e9e9e9"
OUTSIDE = "#CC3311"
BLUE = "#0072B2"
AXIS_COLOUR = {"x": BLUE, "y": "#D55E00", "z": "#009E73"}
# In this order for the parts of a figure that are not axes, such as mountings, methods and inputs.
COLOURS = (*AXIS_COLOUR.values(), "#CC79A7", "#E69F00", "#56B4E9", "#b8b8b8", "#7a5195", "#F0E442")
# Widths of the figures of a page and of a card, inches.
WIDTH, CARD = 7.5, 3.9

# Values of the positions, for one axis or for three, and which of them are drawn.
Values = Float[np.ndarray, " positions"]
OfAxes = Float[np.ndarray, "positions 3"]
Shown = Bool[np.ndarray, " positions"]
# The functions of a result that draw its figures, by name.
Figures = Mapping[str, Callable[..., Figure | None]]

STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 9,
    "date.converter": "concise",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#555555",
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.prop_cycle": cycler(color=COLOURS),
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.5,
    "legend.frameon": False,
    "legend.fontsize": 7.5,
    "svg.fonttype": "path",
    "svg.hashsalt": "tumblecal",
    "savefig.dpi": 150,
}
matplotlib.rcParams.update(STYLE)


def new_panels(
    height: float, rows: int = 1, columns: int = 1, width: float = WIDTH, **shared: Any
) -> tuple[Figure, Any]:
    """A figure (sizes in inches) and its panels (rows, columns); `shared`: such as `sharex`."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **shared)


def new_panel(height: float, width: float = WIDTH, **labels: str) -> tuple[Figure, Axes]:
    """A figure with one panel; `labels`: such as `xlabel`."""
    figure, panels = new_panels(height, width=width)
    panels[0, 0].set(**labels)
    return figure, panels[0, 0]


def in_card(figure: Figure | None, height: float) -> Figure | None:
    """A figure in the size of a card."""
    if figure is not None:
        figure.set_size_inches(CARD, height)
    return figure


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


def svg_text(figure: Figure) -> str:
    """A figure as the text of an SVG file. It is laid out and drawn once; `savefig` does both twice."""
    engine, text = figure.get_layout_engine(), io.StringIO()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine("none")
    FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None, "Creator": "tumblecal"})
    return text.getvalue()


def draw_each(path: Path, figures: Figures, *result: Any) -> dict[str, str]:
    """SVG texts of the figures of a result by name, without those that are None or fail (see `supplement`).

    `path`: the folder or the page that gets them, for messages.
    """
    drawn = {}
    for name, figure_of in figures.items():
        with supplement(path / name):
            if (figure := figure_of(*result)) is not None:
                drawn[name] = svg_text(figure)
    return drawn


def write_each(folder: Path, figures: Figures, *result: Any) -> dict[str, str]:
    """Write the figures of a result into a folder; returns those written, as `draw_each`."""
    written = {}
    for name, text in draw_each(folder, figures, *result).items():
        with supplement(folder / name):
            write_text(folder / name, text)
            written[name] = text
    return written
