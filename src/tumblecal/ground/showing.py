"""How a result shows itself: one screen of text, and in a notebook a table with its figure.

Figures and words of results are functions of `report`, a later folder. The root package, which knows all folders, states
how they are found (`find_drawings_by`); a result names the function, which is loaded when somebody looks. So no folder
refers to a later one, and a result loads neither matplotlib nor polars.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any


if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Rows of a table that a screen holds.
_MOST_ROWS = 24
_CELL = 'style="padding: 0 .7em; text-align: {}"'


_finders: list[Callable[[str], Callable[..., Any]]] = []


def find_drawings_by(find: Callable[[str], Callable[..., Any]]) -> None:
    """State how functions that draw and describe results are found by their names."""
    _finders[:] = [find]


def of_report(name: str) -> Callable[..., Any]:
    """A function that draws or describes a result, by `module.function`, such as `calibration_figures.residuals_figure`."""
    return _finders[-1](name)


def drawn_by(name: str, words: str) -> Callable[[Any], "Figure"]:
    """A method that returns the matplotlib figure which a function of `report` draws; `words`: what it shows."""

    def plot(self: Any) -> "Figure":
        figure = of_report(name)(self)
        if figure is None:
            raise ValueError(f"nothing to draw for these data: {words}")
        return figure

    plot.__doc__ = words
    return plot


def brief(self: Any) -> str:
    """A `__repr__` of one line for what holds arrays and hundreds of parts: shapes and counts in their place."""

    def word(value: Any) -> str:
        if hasattr(value, "dtype"):
            return f"{value.dtype}{[*value.shape]}"
        if isinstance(value, list | tuple | dict):
            return f"{len(value)} of them" if len(value) > 4 or len(repr(value)) > 80 else repr(value)
        text = "function" if callable(value) else repr(value)
        return text if len(text) <= 200 and "\n" not in text else type(value).__name__

    names = getattr(self, "_fields", None) or self.__dataclass_fields__
    return f"{type(self).__name__}({', '.join(f'{name}: {word(getattr(self, name))}' for name in names)})"


@dataclass(frozen=True)
class Screen:
    """What one screen tells: a headline, a table (its first column words, the others numbers), and lines below it."""

    headline: str
    header: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()
    notes: Sequence[str] = ()

    @property
    def _left_out(self) -> list[str]:
        more = len(self.rows) - _MOST_ROWS
        return [f"... and {more} more rows: .table() has all"] if more > 0 else []

    def text(self) -> str:
        """As plain text."""
        cells = [list(self.header), *map(list, self.rows[:_MOST_ROWS])] if self.rows else []
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines = [
            "  ".join(
                cell.ljust(width) if place == 0 else cell.rjust(width)
                for place, (cell, width) in enumerate(zip(row, widths, strict=True))
            ).rstrip()
            for row in cells
        ]
        return "\n".join([self.headline, *lines, *self._left_out, *self.notes])

    def html(self, figure: str = "") -> str:
        """As HTML; `figure`: SVG to stand below."""

        def row(cells: Sequence[str], tag: str) -> str:
            aligned = (_CELL.format("left" if place == 0 else "right") for place in range(len(cells)))
            return "".join(f"<{tag} {way}>{escape(cell)}</{tag}>" for way, cell in zip(aligned, cells, strict=True))

        parts = [f"<p><b>{escape(self.headline)}</b></p>"]
        if self.rows:
            body = "".join(f"<tr>{row(cells, 'td')}</tr>" for cells in self.rows[:_MOST_ROWS])
            parts.append(f"<table><thead><tr>{row(self.header, 'th')}</tr></thead><tbody>{body}</tbody></table>")
        parts += [f"<p>{escape(line)}</p>" for line in (*self._left_out, *self.notes)]
        # Drawings are on white, whatever the notebook's colours are.
        parts += [f'<div style="background: #fff; max-width: 760px">{figure}</div>'] if figure else []
        return f"<div>{''.join(parts)}</div>"


class Shown:
    """What shows itself: `screen` says what; in a notebook `plot_residuals`, where there is one, draws the figure below it."""

    def screen(self) -> Screen:
        """What one screen tells of it."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return self.screen().text()

    def _repr_html_(self) -> str:
        plot = getattr(self, "plot_residuals", None)
        return self.screen().html("" if plot is None else of_report("drawing.inline")(plot()))
