"""Raw readings of any length: tables with columns of three axes, complete or in pieces, with all other columns."""

import math
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from tumblecal.data.cells import ABSOLUTE_ZERO_DEGC, beyond_words, is_empty, mark_advice, unit_advice
from tumblecal.data.files import stated_once
from tumblecal.data.named_layout import layout_of_lines, named_layout, repeated, row_words
from tumblecal.data.parquet import parquet_pieces, scan_parquet
from tumblecal.data.table import DIFFERENT_UNITS, axis_columns
from tumblecal.data.text_layout import ROW, TextLayout
from tumblecal.ground.axes import AXES
from tumblecal.ground.decimal_marks import has_decimal_comma, number_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD, UNITS, Gravity, stated_gravity, unit_in_g
from tumblecal.ground.text_file import comment_in, is_blank, line_in, opened, shown
from tumblecal.ground.units import LARGEST_READING_G


if TYPE_CHECKING:
    import polars as pl

CORRECTED_BY = "corrected_by"
# Number of rows in which the decimal mark is searched.
_SEEN_ROWS = 1000


@dataclass(frozen=True)
class Raw:
    """A table with readings, or a piece of it.

    `frame`: unconverted cells. `readings`: in g, from `columns`, whose unit is `to_g`. `comments`: values of the comment
    `lines`. `gravity`: one g of the readings, None if not stated. `before`: number of earlier rows of the file. For text:
    `layout`; `decimal_comma`, whether the numbers have one; `places`, the line of each row. `row_word`: word for a row in
    messages.
    """

    path: Path
    frame: "pl.DataFrame"
    readings: Float[np.ndarray, "rows 3"]
    columns: tuple[str, str, str]
    to_g: float
    comments: dict[str, str]
    lines: tuple[str, ...]
    gravity: Gravity | None
    before: int = 0
    layout: TextLayout | None = None
    places: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    decimal_comma: bool = False
    row_word: str = "row"

    def with_rows(self, frame: "pl.DataFrame", before: int = 0) -> "Raw":
        """The rows of a piece, after `before` earlier rows of the file.

        **Raises:** `InputError` naming the first cell that is not a reading.
        """
        piece = replace(self, frame=frame, before=before)
        if ROW in frame.columns:
            piece = replace(piece, frame=frame.drop(ROW), places=frame[ROW].to_numpy())
        # In memory axis by axis, like the columns.
        readings = np.stack([piece.numbers(name) for name in self.columns]).T
        readings = readings if self.to_g == 1 else readings * self.to_g
        if readings.size and not (np.max(readings) <= LARGEST_READING_G and np.min(readings) >= -LARGEST_READING_G):
            row, axis = np.unravel_index(np.argmax(np.abs(readings)), readings.shape)
            cell = piece.place(int(row), self.columns[axis])
            raise InputError(f"{cell}: {readings[row, axis]:.3g} g is not a possible reading; remove the row")
        return replace(piece, readings=readings)

    def in_g_of(self, gravity: Gravity | None) -> "Raw":
        """The readings in the g of a calibration; unchanged if the calibration, or a file in g or mg, states no gravity."""
        of_readings = self.gravity or (STANDARD if self.in_ms2 else None)
        if gravity is None or of_readings is None:
            return self
        ratio = of_readings.in_g_of(gravity)
        return replace(self, readings=self.readings * ratio, to_g=self.to_g * ratio, gravity=gravity)

    @property
    def unit(self) -> str:
        """Unit in the names of the columns: g, mg or ms2."""
        return self.columns[0].rpartition("_")[2]

    @property
    def in_ms2(self) -> bool:
        """Whether the columns are in m/s^2."""
        return self.unit == "ms2"

    def place(self, row: int, column: str) -> str:
        """The name of a cell in messages."""
        return f"{self.path}:{self.row_word} {self.number_of(row)}, column {column}"

    @property
    def row_numbers(self) -> np.ndarray:
        """The lines of the rows in text, or their numbers from 1 in other tables."""
        return self.places if len(self.places) else np.arange(len(self.frame)) + self.before + 1

    def number_of(self, row: int) -> int:
        """The line of a row in text, or its number from 1 in other tables."""
        return int(self.row_numbers[row])

    def numbers_if_any(self, name: str) -> Float[np.ndarray, " rows"]:
        """A column as numbers; NaN for other cells."""
        import polars as pl

        column = self.frame[name]
        if not (column.dtype.is_numeric() or column.dtype == pl.String):
            return np.full(len(column), np.nan)
        return self.cast(column).fill_null(math.nan).to_numpy()

    def cast(self, column: "pl.Series") -> "pl.Series":
        """Cells as numbers; null for other cells."""
        import polars as pl

        if column.dtype != pl.String:
            return column.cast(pl.Float64, strict=False)
        return number_of(column, commas=self.decimal_comma)

    def numbers(self, name: str) -> Float[np.ndarray, " rows"]:
        """A column of finite numbers.

        **Raises:** `InputError` naming the first cell that is not a finite number.
        """
        import polars as pl

        column = self.frame[name]
        if not (column.dtype.is_numeric() or column.dtype == pl.String):
            raise InputError(f"{self.path}: column {name}: type {column.dtype}, not numbers; write numbers")
        values = self.cast(column).to_numpy()
        bad = np.nonzero(~np.isfinite(values))[0]
        if len(bad):
            row, more = int(bad[0]), f" ({len(bad)} such cells)" if len(bad) > 1 else ""
            if wrong := self._wrong_row(row):
                raise InputError(f"{self.path}:{self.row_word} {self.number_of(row)}: {wrong}")
            cell = column[row]
            if self.layout and not isinstance(cell, str):
                cell = dict(zip(self.frame.columns, self._line_cells(row), strict=False)).get(name)
            raise InputError(f"{self.place(row, name)}: {self._wrong(cell)}{more}")
        if name == "temperature_degc" and len(values) and values.min() < ABSOLUTE_ZERO_DEGC:
            raise InputError(f"{self.place(int(values.argmin()), name)}: {beyond_words(name, values.min())}")
        return values

    def _line_cells(self, row: int) -> list[str]:
        """The unconverted cells of a row of text; none for other tables, and for a row of several lines."""
        line = line_in(self.path, self.number_of(row)) if self.layout else ""
        return self.layout.cells(line) if self.layout and line.count('"') % 2 == 0 else []

    def _wrong_row(self, row: int) -> str:
        """The fault of a line of text as a row: repeated names, units, too few cells."""
        cells = self._line_cells(row)
        return row_words(cells, self.frame.columns) if cells else ""

    def _wrong(self, cell: object) -> str:
        """Fault of a cell that is not a finite number."""
        if cell is None or (isinstance(cell, str) and not cell.strip()):
            return "the cell is empty; write a number or remove the row"
        text = cell if isinstance(cell, str) else ""
        cure = unit_advice(text) or mark_advice(text).replace("point", "comma" if self.decimal_comma else "point")
        return f"{shown(cell)} is not a finite number; {cure or 'remove the row'}"

    def temperature_degc(self) -> Float[np.ndarray, " rows"] | None:
        """The column of that name; None if it is missing or all its cells are empty."""
        name = "temperature_degc"
        return self.numbers(name) if name in self.frame.columns and not is_empty(self.frame[name]) else None


def read_raw(path: Path, source: Path | None = None) -> Raw:
    """Read a CSV or Parquet table with columns `ax_g, ay_g, az_g` (or `_mg`, `_ms2`) among others.

    **Arguments:**

    - `path`: the table. `source`: its source, named in messages.

    **Raises:** `InputError` for a file without these columns, one that is already corrected, or a cell that is not finite.
    """
    import polars as pl

    header, frames = opened_raw(path, source)
    return header.with_rows(pl.concat(frames()))


def opened_raw(path: Path, source: Path | None = None) -> tuple[Raw, Callable[[], Iterator["pl.DataFrame"]]]:
    """The header of such a table, and its rows in pieces of some hundred thousand; messages name `source`, if given.

    An empty table has one empty piece.

    **Raises:** `InputError` for a file without the columns, with a repeated column, or already corrected.
    """
    if path.suffix != ".parquet":
        return _opened_text(path)
    table, _, comments = scan_parquet(path)
    with _table_faults(path):
        empty = table.head(0).collect()
    header = header_of(source or path, empty, comments, [f"# {key}: {value}" for key, value in comments.items()])
    return header, lambda: parquet_pieces(path, table)


def _opened_text(path: Path) -> tuple[Raw, Callable[[], Iterator["pl.DataFrame"]]]:
    import polars as pl

    layout, comments = named_layout(path)
    if faults := repeated(layout, layout.names):
        raise InputError(faults)
    empty = pl.Schema(dict.fromkeys(layout.names, pl.String)).to_frame()
    header = header_of(path, empty, stated_once(path, comments), [text for _, text in comments])
    if layout.separator == ",":
        # Readings separated by commas have decimal points.
        layout = replace(layout, numeric=frozenset(header.columns))
        empty = empty.cast(dict.fromkeys(header.columns, pl.Float64))
    header = replace(header, frame=empty, layout=layout, row_word="line")

    def longer(line: int) -> None:
        raise InputError(f"{path}:line {line}: {row_words(layout.cells(line_in(path, line)), layout.names)}")

    def frames() -> Iterator["pl.DataFrame"]:
        yield empty.with_columns(pl.Series(ROW, [], pl.Int64))
        yield from layout.frames(layout.names, longer=longer)

    seen = pl.concat([piece.head(_SEEN_ROWS) for piece in islice(frames(), 2)]) if layout.separator != "," else empty
    commas = any(has_decimal_comma(cell) for name in header.columns for cell in seen[name])
    return replace(header, decimal_comma=commas), frames


def header_of(path: Path, empty: "pl.DataFrame", comments: dict[str, str], lines: Sequence[str] = ()) -> Raw:
    """The header of a table with the columns of `empty`.

    **Raises:** as `opened_raw`.
    """
    if CORRECTED_BY in comments:
        raise InputError(f"{path}: these data are corrected already ({CORRECTED_BY}); give the raw file")
    columns = _axis_columns(path, empty.columns)
    unit, gravity = columns[0].rpartition("_")[2], stated_gravity(comments, str(path))
    return Raw(path, empty, np.zeros((0, 3)), columns, unit_in_g(unit, gravity), comments, tuple(lines), gravity)


def column_names(path: Path) -> list[str]:
    """The names in the header of a table, from its first lines; none if there is no header."""
    if path.suffix == ".parquet":
        return scan_parquet(path, check=False)[0].collect_schema().names()
    with opened(path) as file:
        beginning = file.read(1 << 16).decode("utf-8-sig", "replace").splitlines()
    comments = [(k, text) for k, line in enumerate(beginning, 1) if (text := comment_in(line)) is not None]
    others = [(k, line) for k, line in enumerate(beginning, 1) if not is_blank(line) and comment_in(line) is None]
    try:
        return list(layout_of_lines(path, others, comments).names)
    except InputError:
        # The fault is reported when the table is read.
        return [name.strip(' "') for name in re.split("[,;\t|]", others[0][1])] if others else []


@contextmanager
def _table_faults(path: Path) -> Iterator[None]:
    import polars as pl

    try:
        yield
    except InputError:
        raise
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, ValueError) as error:
        raise InputError(f"{path}: not a Parquet file ({(str(error).splitlines() or ['damaged'])[0]})") from error


def _axis_columns(path: Path, names: list[str]) -> tuple[str, str, str]:
    for unit in UNITS:
        wanted = [f"a{axis}_{unit}" for axis in AXES]
        if all(name in names for name in wanted):
            others = [f"a{axis}_{other}" for axis in AXES for other in UNITS if other != unit]
            twice = [name for name in others if name in names]
            if twice:
                raise InputError(f"{path}: {', '.join(wanted + twice)}: the readings are in two units; keep one")
            return wanted[0], wanted[1], wanted[2]
    found = axis_columns(names)
    if {name[:2] for name in found} == {f"a{axis}" for axis in AXES}:
        raise InputError(f"{path}: {', '.join(found)} {DIFFERENT_UNITS}")
    listed = shown(", ".join(names))
    raise InputError(f"{path}: columns ax_g, ay_g, az_g (or _mg, _ms2) are missing; its columns are {listed}")
