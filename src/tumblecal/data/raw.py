"""Raw readings of any length: tables with the three axes' columns, whole or a piece at a time, all else kept."""

import io
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from tumblecal.data.cells import ABSOLUTE_ZERO_DEGC, beyond_words, is_empty, mark_advice, unit_advice
from tumblecal.data.csv_layout import CsvLayout, cells_of, csv_layout, cut_row, longer_row, row_words, rows_behind_marks
from tumblecal.data.decimal_mark import decimal_mark, either_words, may_be_thousands, points_in
from tumblecal.data.files import stated_once
from tumblecal.data.parquet import PIECE_ROWS, parquet_pieces, pieces_in_order, require_plain_texts, scan_parquet
from tumblecal.data.row_lines import RowLines
from tumblecal.data.table import DIFFERENT_UNITS, Table, axis_columns
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD, UNITS, Gravity, stated_gravity, unit_in_g
from tumblecal.ground.last_line import lines_at_end
from tumblecal.ground.text_file import BesideRows, is_blank, line_in, opened, plain_ends, read_beside_rows, shown


if TYPE_CHECKING:
    import polars as pl

CORRECTED_BY = "corrected_by"
# Numbers beyond are no reading and would overflow the sums of squares.
LARGEST_G = 1e6
# So many rows tell the decimal mark.
_SEEN_ROWS = 1000


@dataclass(frozen=True)
class Raw:
    """A table with readings, or a piece of it.

    `frame` as it stands in the file; `readings` in g, from `columns`, one unit of which is `to_g`; `comments` as stated, in
    `lines`; `gravity` is what one g of the readings is, None where the file does not say; `before` rows stand ahead in the
    file, whose lines `places` tells. Text has cells between `separator`, numbers with the mark `decimal`, None where no cell
    tells it. `row_word`: what a row is called in a fault. `header_line`: that of the names in text.
    """

    path: Path
    frame: "pl.DataFrame"
    readings: Float[np.ndarray, "rows 3"]
    columns: tuple[str, str, str]
    to_g: float
    comments: dict[str, str]
    lines: tuple[str, ...]
    gravity: Gravity | None
    places: RowLines = field(default_factory=RowLines)
    before: int = 0
    separator: str = ","
    decimal: str | None = "."
    row_word: str = "row"
    header_line: int = 0

    def with_rows(self, frame: "pl.DataFrame", before: int = 0) -> "Raw":
        """The rows of a piece, of which `before` stand ahead in the file.

        **Raises:** `InputError` naming the first cell that is no reading.
        """
        piece = replace(self, frame=frame, before=before)
        # Axis by axis in memory, as the columns come and go.
        readings = np.stack([piece.numbers(name) for name in self.columns]).T
        readings = readings if self.to_g == 1 else readings * self.to_g
        if readings.size and not (np.max(readings) <= LARGEST_G and np.min(readings) >= -LARGEST_G):
            row, axis = np.unravel_index(np.argmax(np.abs(readings)), readings.shape)
            cell = piece.place(int(row), self.columns[axis])
            raise InputError(f"{cell}: {readings[row, axis]:.3g} g is no reading; remove the row")
        return replace(piece, readings=readings)

    def in_g_of(self, gravity: Gravity | None) -> "Raw":
        """The same readings in the g of a calibration; as they are where it, or a file in g or mg, does not say which."""
        own = self.gravity or (STANDARD if self.in_ms2 else None)
        if gravity is None or own is None:
            return self
        ratio = own.in_g_of(gravity)
        return replace(self, readings=self.readings * ratio, to_g=self.to_g * ratio, gravity=gravity)

    @property
    def unit(self) -> str:
        """That the columns name: g, mg or ms2."""
        return self.columns[0].rpartition("_")[2]

    @property
    def in_ms2(self) -> bool:
        """Whether the columns are in m/s^2."""
        return self.unit == "ms2"

    def place(self, row: int, column: str) -> str:
        """A cell as faults name it."""
        return f"{self.path}:{self.row_word} {self.places.line_of(self.before + row)}, column {column}"

    def numbers_if_any(self, name: str) -> Float[np.ndarray, " rows"]:
        """A column as numbers; not a number where a cell is none."""
        import polars as pl

        column = self.frame[name]
        if not (column.dtype.is_numeric() or column.dtype == pl.String):
            return np.full(len(column), np.nan)
        return self._cast(column).fill_null(math.nan).to_numpy()

    def _cast(self, column: "pl.Series") -> "pl.Series":
        """Cells as numbers, null where one is none."""
        import polars as pl

        cells = column.str.strip_chars() if column.dtype == pl.String else column
        if self.separator != "," and column.dtype == pl.String:
            cells = points_in(cells, self.decimal)
        return cells.cast(pl.Float64, strict=False)

    def numbers(self, name: str) -> Float[np.ndarray, " rows"]:
        """A column of finite numbers.

        **Raises:** `InputError` naming the first cell that is none.
        """
        import polars as pl

        column = self.frame[name]
        if not (column.dtype.is_numeric() or column.dtype == pl.String):
            raise InputError(f"{self.path}: column {name}: holds {column.dtype}, not numbers; write numbers")
        values = self._cast(column).to_numpy()
        bad = np.nonzero(~np.isfinite(values))[0]
        if len(bad):
            row, more = int(bad[0]), f" ({len(bad)} such cells)" if len(bad) > 1 else ""
            if wrong := self._wrong_row(row):
                raise InputError(f"{self.path}:{self.row_word} {self.places.line_of(self.before + row)}: {wrong}")
            raise InputError(f"{self.place(row, name)}: {self._wrong(column[row])}{more}")
        if name == "temperature_degc" and len(values) and values.min() < ABSOLUTE_ZERO_DEGC:
            raise InputError(f"{self.place(int(values.argmin()), name)}: {beyond_words(name, values.min())}")
        return values

    def _wrong_row(self, row: int) -> str:
        """What is wrong with a whole line of text as a row: the names again, units, too few cells."""
        if self.row_word != "line":
            return ""
        cells = cells_of(line_in(self.path, self.places.line_of(self.before + row)), self.separator)
        # Cells over several lines make the lines uncertain.
        same = [cell for cell in cells if cell] == [
            cell.strip() for cell in self.frame.row(row) if cell and cell.strip()
        ]
        return row_words(cells, self.frame.columns) if same else ""

    def _wrong(self, cell: object) -> str:
        """What is wrong with a cell that is no finite number."""
        if isinstance(cell, str) and may_be_thousands(cell, self.separator, self.decimal):
            return either_words(cell.strip(), self.decimal)
        if cell is None or (isinstance(cell, str) and not cell.strip()):
            return "the cell is empty; write a number or remove the row"
        text = cell if isinstance(cell, str) else ""
        cure = unit_advice(text) or (mark_advice(text) if self.decimal != "," else "")
        return f"{shown(cell)} is not a finite number; {cure or 'remove the row'}"

    def temperature_degc(self) -> Float[np.ndarray, " rows"] | None:
        """The column of that name; None where there is none, or it is empty throughout."""
        name = "temperature_degc"
        return self.numbers(name) if name in self.frame.columns and not is_empty(self.frame[name]) else None


def read_raw(path: Path, source: Path | None = None) -> Raw:
    """Read a CSV or Parquet table with columns `ax_g, ay_g, az_g` (or `_mg`, `_ms2`) among others.

    **Arguments:**

    - `path`: the table. `source`: what it was made of, to be named in faults.

    **Raises:** `InputError` for a file without them, already corrected, or with a cell that is no finite number.
    """
    header, table = opened_raw(path, source)
    with _table_faults(path):
        frame = table.collect()
    if path.suffix == ".parquet":  # a text was looked at as a whole
        require_plain_texts(header.path, frame)
    return header.with_rows(header.places.without_blank(path, frame))


def opened_raw(path: Path, source: Path | None = None) -> tuple[Raw, "pl.LazyFrame"]:
    """What such a table states, without its rows, and the rows, not read yet; `source` is named in place of `path`.

    **Raises:** `InputError` for a file without the columns, with one of them twice, or already corrected.
    """
    if path.suffix != ".parquet":
        return _opened_csv(path)
    table, _, comments = scan_parquet(path)
    with _table_faults(path):
        empty = table.head(0).collect()
    return header_of(source or path, empty, comments, [f"# {key}: {value}" for key, value in comments.items()]), table


def _opened_csv(path: Path) -> tuple[Raw, "pl.LazyFrame"]:
    import polars as pl

    beside = read_beside_rows(path)
    layout = csv_layout(path, beside.beginning, beside.comments)
    if faults := layout.repeated(path) + rows_behind_marks(path, layout, beside.comments):
        raise InputError(faults)
    comments = [own for own in beside.comments if own[0] != layout.header_line]
    names = layout.names_of_cells(beside.beginning)
    empty = pl.Schema(dict.fromkeys(names, pl.String)).to_frame()
    header = header_of(path, empty, stated_once(path, comments), [text for _, text in comments])
    # The table's reader takes the number of columns from the first line that it reads: the header, where that tells it.
    told = len(comments) == len(beside.comments) and names == layout.names
    first = layout.rows_from if told else next(line for line, _ in beside.beginning if line >= layout.rows_from)
    with _table_faults(path):
        table = pl.scan_csv(
            path if beside.plain else _plain(path),
            has_header=told,
            infer_schema=False,
            separator=layout.separator,
            skip_lines=first - 2 if told else first - 1,
            comment_prefix="#",
            glob=False,
        )
        read = table.collect_schema().names()
    if len(read) != len(names):
        raise InputError(
            f"{path}:line {layout.header_line}: the header goes over several lines; check the quotation marks"
        )
    table = table.rename(dict(zip(read, names, strict=True)))
    blank = np.array(beside.blank, int)
    places = RowLines(first, np.array([line for line, _ in comments], int), blank)
    header = replace(header, places=places, separator=layout.separator, row_word="line", header_line=layout.header_line)
    _check_last_line(path, layout, beside)
    return (header if layout.separator == "," else replace(header, decimal=_decimal(header, table))), table


def _check_last_line(path: Path, layout: CsvLayout, beside: BesideRows) -> None:
    """Refuse a table whose last line has no end and may be cut off.

    **Raises:** `InputError`.
    """
    lines, ended = lines_at_end(path)
    if ended or not lines or beside.lines < layout.rows_from or is_blank(lines[-1]) or lines[-1].startswith("#"):
        return
    above = max(0, len(lines) - (beside.lines - layout.rows_from + 1))
    rows = [cells_of(line, layout.separator) for line in lines[above:]]
    if cut := cut_row(path, beside.lines, layout.names_of_cells(beside.beginning), rows):
        raise InputError(cut)


def _plain(path: Path) -> io.BytesIO:
    """A text in another encoding, or with other ends of lines, as the table's reader takes it: in memory."""
    with opened(path) as file:
        return io.BytesIO(plain_ends(file.read()))


def _decimal(header: Raw, table: "pl.LazyFrame") -> str | None:
    """The decimal mark of a table's readings, by its first rows; None where they do not tell it.

    **Raises:** `InputError` where marks contradict one another.
    """
    with _table_faults(header.path):
        frame = header.places.without_blank(header.path, table.head(_SEEN_ROWS).collect())
    lines = [header.places.line_of(row) for row in range(len(frame))]
    return decimal_mark(Table(str(header.path), {name: frame[name].to_list() for name in header.columns}, lines, {}))


def header_of(path: Path, empty: "pl.DataFrame", comments: dict[str, str], lines: Sequence[str] = ()) -> Raw:
    """What a table states whose columns are those of `empty`.

    **Raises:** as `opened_raw`.
    """
    if CORRECTED_BY in comments:
        raise InputError(f"{path}: these data are corrected already ({CORRECTED_BY}); give the raw file")
    columns = _axis_columns(path, empty.columns)
    unit, gravity = columns[0].rpartition("_")[2], stated_gravity(comments, str(path))
    return Raw(path, empty, np.zeros((0, 3)), columns, unit_in_g(unit, gravity), comments, tuple(lines), gravity)


def frames_of(header: Raw, table: "pl.LazyFrame") -> Iterator["pl.DataFrame"]:
    """The rows of a table in order, some hundred thousand at a time; those of an empty one are one empty piece."""
    path, before = header.path, 0
    with _table_faults(path):
        parquet = path.suffix == ".parquet"
        for frame in parquet_pieces(path, table) if parquet else pieces_in_order(table, PIECE_ROWS):
            yield header.places.without_blank(path, frame, before)
            before += len(frame)


def column_names(path: Path) -> list[str]:
    """The names in a table's header, as far as its first lines tell; none of what has none."""
    if path.suffix == ".parquet":
        return scan_parquet(path, check=False)[0].collect_schema().names()
    with opened(path) as file:
        beginning = file.read(1 << 16)
    beside = BesideRows()
    beside.add("\n".join(beginning.decode("utf-8-sig", "replace").splitlines()), 0)
    try:
        return list(csv_layout(path, beside.beginning, beside.comments).names)
    except InputError:
        # Whoever opens it as such a table says what is wrong with it.
        line = beside.beginning[0][1] if beside.beginning else ""
        return [name.strip(' "') for name in re.split("[,;\t]", line)] if line else []


@contextmanager
def _table_faults(path: Path) -> Iterator[None]:
    import polars as pl

    try:
        yield
    except InputError:
        raise
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, ValueError) as error:
        if "found more fields" in str(error):
            raise InputError(longer_row(path)) from error
        kind = "Parquet file" if path.suffix == ".parquet" else "CSV table"
        raise InputError(f"{path}: not a {kind} ({(str(error).splitlines() or ['damaged'])[0]})") from error


def _axis_columns(path: Path, names: list[str]) -> tuple[str, str, str]:
    for unit in UNITS:
        wanted = [f"a{axis}_{unit}" for axis in AXES]
        if all(name in names for name in wanted):
            others = [f"a{axis}_{other}" for axis in AXES for other in UNITS if other != unit]
            twice = [name for name in others if name in names]
            if twice:
                raise InputError(f"{path}: {', '.join(wanted + twice)}: the readings stand in two units; keep one")
            return wanted[0], wanted[1], wanted[2]
    found = axis_columns(names)
    if {name[:2] for name in found} == {f"a{axis}" for axis in AXES}:
        raise InputError(f"{path}: {', '.join(found)} {DIFFERENT_UNITS}")
    there = shown(", ".join(names))
    raise InputError(f"{path}: columns ax_g, ay_g, az_g (or _mg, _ms2) are missing; it has {there}")
