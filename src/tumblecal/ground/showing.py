"""Display of results: one screen of text, and in a notebook a table with its figure.

Figures and words of results are functions of `report`, a higher layer. The root package, which knows all folders, registers
a function that finds them (`find_drawings_by`). A result has only the name of its function, which is imported when it is
displayed. So no folder imports a higher one, and a result imports neither matplotlib nor polars.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any


if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Largest number of rows of a table on a screen.
_MOST_ROWS = 24
_CELL = 'style="padding: 0 .7em; text-align: {}"'


_finders: list[Callable[[str], Callable[..., Any]]] = []


def find_drawings_by(find: Callable[[str], Callable[..., Any]]) -> None:
    """Register the function that finds drawing and describing functions by their names."""
    _finders[:] = [find]


def function_named(name: str) -> Callable[..., Any]:
    """A function of a later room that draws, describes or saves a result, by its path, such as `lab.record.save_fit`."""
    return _finders[-1](name)


# A method that returns a figure of its object (type checkers bind no method that is stated with its first argument).
Drawing = Callable[..., "Figure"]


def drawn_by(name: str, words: str) -> Drawing:
    """A method that returns the matplotlib figure of a function of `show`; `words`: its docstring."""

    def plot(self: Any) -> "Figure":
        figure = function_named(name)(self)
        if figure is None:
            raise ValueError(f"nothing to draw for these data: {words}")
        return figure

    plot.__doc__ = words
    return plot


def brief(self: Any) -> str:
    """A `__repr__` of one line for objects with large arrays and sequences, shown by their shapes and lengths."""

    def word(value: Any) -> str:
        if hasattr(value, "dtype"):
            return f"{value.dtype}{[*value.shape]}"
        if isinstance(value, list | tuple | dict):
            return f"{len(value)} items" if len(value) > 4 or len(repr(value)) > 80 else repr(value)
        text = "function" if callable(value) else repr(value)
        return text if len(text) <= 200 and "\n" not in text else type(value).__name__

    names = getattr(self, "_fields", None) or self.__dataclass_fields__
    return f"{type(self).__name__}({', '.join(f'{name}: {word(getattr(self, name))}' for name in names)})"


@dataclass(frozen=True)
class Screen:
    """One screen of text: a headline, a table (first column words, other columns numbers), and notes below it."""

    headline: str
    header: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()
    notes: Sequence[str] = ()

    @property
    def _omitted(self) -> list[str]:
        more = len(self.rows) - _MOST_ROWS
        return [f"... and {more} more rows: .table() has all"] if more > 0 else []

    def text(self) -> str:
        """The screen as plain text."""
        cells = [list(self.header), *map(list, self.rows[:_MOST_ROWS])] if self.rows else []
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines = [
            "  ".join(
                cell.ljust(width) if place == 0 else cell.rjust(width)
                for place, (cell, width) in enumerate(zip(row, widths, strict=True))
            ).rstrip()
            for row in cells
        ]
        return "\n".join([self.headline, *lines, *self._omitted, *self.notes])

    def html(self, figure: str = "") -> str:
        """The screen as HTML; `figure`: SVG below the table."""

        def row(cells: Sequence[str], tag: str) -> str:
            aligned = (_CELL.format("left" if place == 0 else "right") for place in range(len(cells)))
            return "".join(f"<{tag} {way}>{escape(cell)}</{tag}>" for way, cell in zip(aligned, cells, strict=True))

        parts = [f"<p><b>{escape(self.headline)}</b></p>"]
        if self.rows:
            body = "".join(f"<tr>{row(cells, 'td')}</tr>" for cells in self.rows[:_MOST_ROWS])
            parts.append(f"<table><thead><tr>{row(self.header, 'th')}</tr></thead><tbody>{body}</tbody></table>")
        parts += [f"<p>{escape(line)}</p>" for line in (*self._omitted, *self.notes)]
        # Drawings have a white background, also in a dark notebook.
        parts += [f'<div style="background: #fff; max-width: 760px">{figure}</div>'] if figure else []
        return f"<div>{''.join(parts)}</div>"


class Shown:
    """A result with a display: `screen` gives its text; in a notebook `plot_residuals`, if it exists, draws a figure below."""

    def screen(self) -> Screen:
        """The screen of this result."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return self.screen().text()

    def _repr_html_(self) -> str:
        plot = getattr(self, "plot_residuals", None)
        svg = "" if plot is None else function_named("show.figures.drawing.svg_text")(plot())
        return self.screen().html(svg[svg.find("<svg") :] if svg else "")
