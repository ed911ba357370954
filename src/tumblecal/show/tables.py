"""A table as a record: HTML on a page, aligned text on a terminal of any width; without numpy, so that lists come at once."""

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass


_GAP = 2


@dataclass(frozen=True)
class Table:
    """A table: header cells and rows of cells.

    - `text`: columns of words: left-aligned; on a page they may break into lines. All others contain numbers.
    - `shares`: columns of numbers from 0 to 1, drawn as bars on a page. `marked`: cells (row, column) emphasised there.
    - `folded`: whether it is closed at first on a page, as a figure shows the same.
    """

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    text: Sequence[int] = ()
    shares: Sequence[int] = ()
    marked: Collection[tuple[int, int]] = ()
    folded: bool = False

    def __str__(self) -> str:
        return "\n".join(line for lines in self.parts() for part in lines for line in part)

    def parts(self, room: float = math.inf) -> Iterator[tuple[list[str], list[str]]]:
        """Lines of header and rows; if the columns do not fit into `room`, parts below one another, each with the first."""
        heads = [cell.split("\n") for cell in self.header]
        height = max(map(len, heads))
        above = list(zip(*([""] * (height - len(head)) + head for head in heads), strict=True))
        lines = [*above, *self.rows]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        for part in _fitting(widths, room):
            aligned = [
                (" " * _GAP)
                .join((str.ljust if k in self.text else str.rjust)(line[k], widths[k]) for k in part)
                .rstrip()
                for line in lines
            ]
            yield aligned[:height], aligned[height:]


def _fitting(widths: Sequence[int], room: float) -> Iterator[list[int]]:
    """Columns that fit in one line, with the first column in each part."""
    part = [0]
    for place in range(1, len(widths)):
        if len(part) > 1 and sum(widths[k] + _GAP for k in (*part, place)) - _GAP > room:
            yield part
            part = [0]
        part.append(place)
    yield part


def number(value: float | None, digits: int = 3) -> str:
    """A number in a table; "" for one that does not exist."""
    return "" if value is None or not math.isfinite(value) else f"{value:.{digits}g}"
