"""Style of all figures, and writing them: SVG, no display needed, reproducible to the bit."""

import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import matplotlib
import numpy as np


matplotlib.use("Agg")

from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from tumblecal.ground.atomic import write_text, written_aside
from tumblecal.ground.supplement import supplement


# Colours that colour-blind readers distinguish, also in grey (Okabe and Ito 2008).
INK = "#222222"
MUTED = "#9a9a9a"
BAND = "#e9e9e9"
OUTSIDE = "#CC3311"
AXIS_COLOUR = {"x": "#0072B2", "y": "#D55E00", "z": "#009E73"}
METHOD_COLOUR = {
    "least squares": "#b8b8b8",
    "running mean": "#E69F00",
    "Kalman": "#0072B2",
    "exact": "#CC3311",
    "truth": INK,
}

STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#555555",
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "svg.fonttype": "path",
    "svg.hashsalt": "tumblecal",
    "figure.dpi": 100,
    "savefig.dpi": 150,
}
matplotlib.rcParams.update(STYLE)


def new_figure(width: float = 7.5, height: float = 3.0) -> Figure:
    """An empty figure; sizes in inches."""
    return Figure(figsize=(width, height), layout="constrained")


class Margins(NamedTuple):
    """Free space at the sides of the panels of a figure and between them, inches."""

    left: float
    right: float
    bottom: float
    top: float
    across: float
    down: float


def new_panels(width: float, height: float, rows: int, columns: int, margins: Margins) -> tuple[Figure, np.ndarray]:
    """A figure of many panels with shared axes and fixed margins: measuring the texts would take as long as drawing."""
    figure = Figure(figsize=(width, height))
    inner = (width - margins.left - margins.right, height - margins.bottom - margins.top)
    wide, high = ((inner[0] - (columns - 1) * margins.across) / columns, (inner[1] - (rows - 1) * margins.down) / rows)
    figure.subplots_adjust(
        left=margins.left / width,
        right=1.0 - margins.right / width,
        bottom=margins.bottom / height,
        top=1.0 - margins.top / height,
        wspace=margins.across / wide,
        hspace=margins.down / high,
    )
    return figure, figure.subplots(rows, columns, sharex="col", sharey="row", squeeze=False)


def _write_svg(figure: Figure, to: Path | io.StringIO) -> None:
    """A figure laid out and drawn once: `savefig` does both twice."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine("none")
    FigureCanvasSVG(figure).print_svg(to, metadata={"Date": None, "Creator": "tumblecal"})


def svg_text(figure: Figure) -> str:
    """A figure as the text of an SVG file."""
    text = io.StringIO()
    _write_svg(figure, text)
    return text.getvalue()


_Drawn = TypeVar("_Drawn")


def draw_each(
    folder: Path,
    figures: Mapping[str, Callable[[], Figure | None]],
    put: Callable[[Figure, Path], _Drawn],
) -> dict[str, _Drawn]:
    """Draw each figure, without those that are None or fail (see `supplement`).

    **Arguments:**

    - `folder`, `figures`: file, and the function that makes the figure, by name. `put`: saves it or makes its text.

    **Returns:** what `put` returns, by name.
    """
    drawn = {}
    for name, figure_of in figures.items():
        with supplement(folder / name):
            figure = figure_of()
            if figure is not None:
                drawn[name] = put(figure, folder / name)
    return drawn


def save(figure: Figure, path: Path) -> Path:
    """Write a complete figure (SVG or PNG by the name), or none."""
    if path.suffix == ".svg":
        write_text(path, svg_text(figure))
        return path
    with written_aside(path) as aside:
        figure.savefig(aside, format=path.suffix[1:], metadata={"Software": "tumblecal"})
    return path
