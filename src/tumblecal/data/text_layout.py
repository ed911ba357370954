"""Layout of delimited text, determined once from its lines, and its rows."""

import csv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.data.text_cells import (
    QUOTED_END,
    cells_of,
    frame_of,
    joined_pieces,
    pieces_of,
    row_lines,
    strict_cells,
)
from tumblecal.ground.text_file import comment_in, is_blank, lines_at_end, may_be_cut


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
        """Lines from the first row on, with the number of the first line of each piece; a quoted cell is in one line."""
        line = self.first_line
        for piece in joined_pieces(pieces_of(self.path, line), self.separator, len(self.names)):
            yield line, self.form.applied(piece) if self.form else piece
            line += piece.count(b"\n")

    def frames(
        self,
        names: Sequence[str],
        *,
        check: Callable[[bytes], None] = lambda piece: None,
        longer: Callable[[int], None] = lambda line: None,
        cut: Callable[[int], None] | None = None,
    ) -> Iterator["pl.DataFrame"]:
        """The rows of these columns and their lines (`ROW`), in pieces; cells of rows that are too long are null.

        **Arguments:**

        - `check`: called first with each piece. `longer`: called with the line of the first row of a piece that is too long.
        - `cut`: called with the line of a last row that may be truncated, which becomes null.
        """
        import polars as pl

        for line, piece in self.pieces():
            check(piece)
            frame = frame_of(piece, self.separator, [name in self.numeric for name in self.names])
            more = frame["more"].is_not_null()
            cells = [pl.col(f"c{self.names.index(name)}").alias(name) for name in names]
            are_rows = row_lines(piece)
            lines = pl.Series(ROW, range(line, line + len(frame)))
            frame = frame.select(cells).with_columns(lines)
            if more.any():
                rows = more if are_rows is None else more & pl.Series(are_rows)
                if rows.any():
                    longer(line + int(rows.arg_max() or 0))
                frame = frame.with_columns(pl.when(~more).then(pl.col(name)) for name in names)
            if cut and not piece.endswith(b"\n") and self.cut_row("most"):
                cut(line + len(frame) - 1)
                frame = frame.with_columns(
                    pl.col(name).slice(0, len(frame) - 1).extend_constant(None, 1) for name in names
                )
            yield frame if are_rows is None else frame.filter(pl.Series(are_rows))

    def rows(self) -> Iterator[tuple[int, list[str], str]]:
        """The line and the cells of each row of strict CSV, and the fault of its quotation marks."""
        for line, piece in self.pieces():
            lines = piece.removesuffix(b"\n").decode().split("\n")
            are_rows = row_lines(piece) or [True] * len(lines)
            for k, (text, is_row) in enumerate(zip(lines, are_rows, strict=True)):
                if not is_row:
                    continue
                if '"' not in text:
                    yield line + k, text.split(self.separator), ""
                    continue
                try:
                    yield line + k, strict_cells(text.replace(QUOTED_END, "\n"), self.separator), ""
                except csv.Error as error:
                    yield line + k, [], f"{error}; check the quotation marks"

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
