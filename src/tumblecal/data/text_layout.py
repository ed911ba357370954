"""Layout of delimited text, determined once from its lines, and its rows."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tumblecal.data.text_cells import (
    QUOTED_END,
    cells_of,
    frame_of,
    pieces_of,
    restored,
    row_lines,
    unquoted,
    with_whole_cells,
    without_comments,
)
from tumblecal.ground.text_file import EMPTY_CELLS, comment_in, is_blank, lines_at_end, may_be_cut


if TYPE_CHECKING:
    import polars as pl

    from tumblecal.data.line_form import LineForm

# Column of frames with the line (or row) of each row in its source, for messages.
ROW = "\x00row"
SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "pipes", " ": "spaces"}


@dataclass(frozen=True)
class TextLayout:
    """Layout of the lines of a text.

    **Arguments:**

    - `names`: of the columns. `separator`: between cells; a space means any blanks.
    - `numeric`: columns whose cells become numbers, with decimal points; null for other cells.
    - `header_line`: the line of the names, None if no line has them; `first_line`: that of the first row, both from 1.
    - `form`: conversion of lines with words around their numbers.
    """

    path: Path
    names: tuple[str, ...]
    separator: str
    header_line: int | None
    first_line: int
    form: "LineForm | None" = None
    numeric: frozenset[str] = frozenset()

    def words(self) -> str:
        """The layout in words."""
        between = f"separated by {SEPARATORS[self.separator]}" if self.separator in SEPARATORS else "between words"
        words = f"text, {len(self.names)} columns {between}"
        return words + (f", first row in line {self.first_line}" if self.first_line > 1 else ", no header line")

    def pieces(self) -> Iterator[tuple[int, bytes]]:
        """Lines from the first row on, without marks around quoted cells, and the number of the first one in each piece."""
        line = self.first_line
        for piece in with_whole_cells(pieces_of(self.path, line)):
            converted = self.form.applied(piece) if self.form else piece
            yield line, unquoted(without_comments(converted), self.separator)
            line += piece.count(b"\n")

    def frames(self, names: Sequence[str], *, cut: Callable[[int], None] | None = None) -> Iterator["pl.DataFrame"]:
        """The rows of these columns and their lines (`ROW`), in pieces; cells of rows that are too long are null.

        **Arguments:**

        - `cut`: called with the line of a last row that may be truncated, which becomes null.
        """
        import polars as pl

        for line, piece in self.pieces():
            frame = frame_of(piece, self.separator, [name in self.numeric for name in self.names])
            cells = [pl.col(f"c{self.names.index(name)}").alias(name) for name in names]
            if frame["more"].is_not_null().any():
                cells = [pl.when(pl.col("more").is_null()).then(cell) for cell in cells]
            numbers = np.arange(line, line + len(frame))
            if QUOTED_END.encode() in piece:
                ends = [text.count(QUOTED_END.encode()) for text in piece.split(b"\n")[: len(frame) - 1]]
                numbers[1:] += np.cumsum(ends, dtype=int)
            if cut and not piece.endswith(b"\n") and self.cut_row("most"):
                cut(int(numbers[-1]))
                last = pl.int_range(pl.len()) == pl.len() - 1
                cells = [pl.when(~last).then(cell) for cell in cells]
            frame = frame.select(cells).with_columns(pl.Series(ROW, numbers))
            are_rows = row_lines(piece)
            yield frame if are_rows is None else frame.filter(pl.Series(are_rows))

    def rows(self) -> Iterator[tuple[int, list[str], str]]:
        """The line and the cells of each row of strict CSV, and the fault of its quotation marks."""
        for line, piece in self.pieces():
            for text in piece.removesuffix(b"\n").decode().split("\n"):
                if text.strip(EMPTY_CELLS):
                    fault = "quotation marks within a cell; check the quotation marks" if '"' in text else ""
                    yield line, [restored(cell, self.separator) for cell in text.split(self.separator)], fault
                line += 1 + text.count(QUOTED_END)

    def cut_row(self, digits: str = "fewest") -> list[str]:
        """The cells of a last line without a line end that may be truncated, compared with other lines; otherwise none.

        **Arguments:**

        - `digits`: whether it needs the "fewest" or the "most" decimals of the other lines.
        """
        lines, ended = lines_at_end(self.path)
        lines = [self.form.line(line) for line in lines] if self.form else lines
        if ended or (lines and (is_blank(lines[-1]) or comment_in(lines[-1]) is not None)):
            return []
        rows = [self.cells(line) for line in lines if comment_in(line) is None] or [[""]]  # of a line of many kilobytes
        others = [row[-1] for row in rows[:-1] if len(row) == len(rows[-1]) and row != [*self.names]]
        # An empty last column is not in the layout, but its separators are in the lines.
        usual = len(rows[-1]) == len(self.names) or (others and len(rows[-1]) == len(self.names) + 1)
        return rows[-1] if not usual or may_be_cut(rows[-1][-1], others, digits=digits) else []

    def cells(self, line: str) -> list[str]:
        """The cells of a line, with the empty cell after a separator at its end."""
        return cells_of(line, self.separator)
