"""A table as a record: HTML on a page, aligned text on a terminal of any width; without numpy, so that lists come at once."""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property


_GAP = 2
# The beginning of a cell with a number, such as `+0.5`, `(2 +- 1)e-3` or `> 4`; and a cell without a value.
_NUMBER, _NONE = re.compile(r"[-+<>(~ ]*\d"), ("", "-")


@dataclass(frozen=True)
class Table:
    """A table: header cells and rows of cells.

    `folded`: whether it is closed at first on a page, as a figure shows the same.
    """

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    folded: bool = False

    @cached_property
    def text(self) -> set[int]:
        """Columns of words, in most of whose cells there is no number, and all without header: left-aligned; on a page they may
        break into lines."""
        columns = [[cell for cell in cells if cell not in _NONE] for cells in zip(*self.rows, strict=True)]
        return {
            k
            for k, cells in enumerate(columns)
            if not any(self.header) or len(cells) > 2 * sum(map(bool, map(_NUMBER.match, cells)))
        }

    def __str__(self) -> str:
        return self.fitted()

    def fitted(self, room: float = math.inf) -> str:
        """The table as text; its parts with a blank line between them."""
        return "\n\n".join("\n".join([*header, *rows]) for header, rows in self.parts(room))

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
