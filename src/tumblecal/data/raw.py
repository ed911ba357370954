"""Raw readings of any length: tables with columns of three axes, complete or in pieces, with all other columns."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from tumblecal.data.cells import beyond_words, number_in
from tumblecal.data.files import stated_once
from tumblecal.data.named_layout import layout_of_lines, named_layout, parted, require_different, row_words
from tumblecal.data.parquet import parquet_pieces, scan_parquet
from tumblecal.data.table import DIFFERENT_UNITS, axis_columns
from tumblecal.data.text_layout import ROW, TextLayout
from tumblecal.ground.axes import AXES
from tumblecal.ground.decimal_marks import has_decimal_comma, number_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD, Gravity, stated_gravity, unit_in_g
from tumblecal.ground.text_file import line_in, opened, shown
from tumblecal.ground.units import LARGEST_READING_G


if TYPE_CHECKING:
    import polars as pl

CORRECTED_BY = "corrected_by"
# Number of rows in which the decimal mark is searched.
_SEEN_ROWS = 1000
_TEMPERATURE = "temperature_degc"


@dataclass(frozen=True)
class Raw:
    """A table with readings, or a piece of it.

    `frame`: unconverted cells. `readings`: in g, from `columns`, whose unit is `to_g`. `comments`: values of the comment
    lines. `gravity`: one g of the readings, None if not stated. `row_numbers`: the line of each row in text, its number in
    other tables; `row_word`: word for a row in messages. For text: `layout`; `decimal_comma`, whether the numbers have one.
    """

    path: Path
    frame: "pl.DataFrame"
    readings: Float[np.ndarray, "rows 3"]
    columns: tuple[str, str, str]
    to_g: float
    comments: dict[str, str]
    gravity: Gravity | None
    row_numbers: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    layout: TextLayout | None = None
    decimal_comma: bool = False
    row_word: str = "row"

    def with_rows(self, frame: "pl.DataFrame", before: int = 0) -> "Raw":
        """The rows of a piece, after `before` earlier rows of the file.

        **Raises:** `InputError` naming the first cell that is not a reading.
        """
        numbers = frame[ROW].to_numpy() if ROW in frame.columns else np.arange(len(frame)) + before + 1
        piece = replace(self, frame=frame.drop(ROW, strict=False), row_numbers=numbers)
        # In memory axis by axis, like the columns.
        readings = np.stack([piece.numbers(name) for name in self.columns]).T
        readings = readings if self.to_g == 1 else readings * self.to_g
        if readings.size and not (np.max(readings) <= LARGEST_READING_G and np.min(readings) >= -LARGEST_READING_G):
            row, axis = np.unravel_index(np.argmax(np.abs(readings)), readings.shape)
            words = (
                f"column {self.columns[axis]}: {readings[row, axis]:.3g} g is not a possible reading; remove the row"
            )
            raise InputError(f"{piece.place(int(row))}, {words}")
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

    def place(self, row: int) -> str:
        """The name of a row in messages."""
        return f"{self.path}:{self.row_word} {self.row_numbers[row]}"

    def numbers_if_any(self, name: str) -> Float[np.ndarray, " rows"]:
        """A column as numbers; NaN for other cells."""
        import polars as pl

        column = self.frame[name]
        if column.dtype == pl.String:
            column = number_of(column, commas=self.decimal_comma)
        elif not column.dtype.is_numeric():
            return np.full(len(column), np.nan)
        return column.cast(pl.Float64, strict=False).fill_null(math.nan).to_numpy()

    def numbers(self, name: str) -> Float[np.ndarray, " rows"]:
        """A column of finite numbers.

        **Raises:** `InputError` naming the first cell that is not a finite number, and impossible temperatures.
        """
        values = self.numbers_if_any(name)
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            row, cell, wrong = int(bad[0]), self.frame[name][int(bad[0])], ""
            if self.layout and (line := line_in(self.path, self.row_numbers[row])).count('"') % 2 == 0:
                # Cells of text that are numbers in the frame, and rows of a wrong length, are null.
                cells = self.layout.cells(line)
                wrong = row_words(cells, self.layout.names)
                cell = cell if wrong else cells[self.layout.names.index(name)]
            if wrong:
                raise InputError(f"{self.place(row)}: {wrong}")
            more = f" ({len(bad)} such cells)" if len(bad) > 1 else ""
            words = (
                number_in(cell, name)[1] or f"{shown(cell)} is not a number here; write numbers with one decimal mark"
            )
            raise InputError(f"{self.place(row)}, column {name}: {words}{more}")
        if name == _TEMPERATURE and len(values) and (wrong := beyond_words(name, values.min())):
            raise InputError(f"{self.place(int(values.argmin()))}, column {name}: {wrong}")
        return values

    def temperature_degc(self) -> Float[np.ndarray, " rows"] | None:
        """The column of that name; None if it is missing or all its cells are empty."""
        if _TEMPERATURE not in self.frame.columns:
            return None
        cells = self.frame[_TEMPERATURE].cast(str).str.strip_chars()
        return None if cells.is_in(["", "NaN"]).fill_null(value=True).all() else self.numbers(_TEMPERATURE)


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
    import polars as pl

    if path.suffix == ".parquet":
        table, _, comments = scan_parquet(path)
        header = header_of(source or path, table.collect_schema().to_frame(), comments)
        return header, lambda: parquet_pieces(path, table)
    layout, lines = named_layout(path)
    require_different(layout, layout.names)
    empty = pl.Schema(dict.fromkeys(layout.names, pl.String)).to_frame()
    header = header_of(path, empty, stated_once(path, lines))
    if layout.separator == ",":
        # Readings separated by commas have decimal points.
        layout = replace(layout, numeric=frozenset(header.columns))
        empty = empty.cast(dict.fromkeys(header.columns, pl.Float64))

    def frames() -> Iterator["pl.DataFrame"]:
        yield empty.with_columns(pl.Series(ROW, [], pl.Int64))
        yield from layout.frames(layout.names)

    seen = pl.concat([piece.head(_SEEN_ROWS) for piece in islice(frames(), 2)]) if layout.separator != "," else empty
    commas = any(has_decimal_comma(cell) for name in header.columns for cell in seen[name])
    return replace(header, frame=empty, layout=layout, row_word="line", decimal_comma=commas), frames


def header_of(path: Path, empty: "pl.DataFrame", comments: dict[str, str]) -> Raw:
    """The header of a table with the columns of `empty`.

    **Raises:** as `opened_raw`.
    """
    if CORRECTED_BY in comments:
        raise InputError(f"{path}: these data are corrected already ({CORRECTED_BY}); give the raw file")
    found = axis_columns(empty.columns)
    listed = f"{path}: {', '.join(found)}"
    if {name[1] for name in found} != {*AXES}:
        names = shown(", ".join(empty.columns))
        raise InputError(f"{path}: columns ax_g, ay_g, az_g (or _mg, _ms2) are missing; its columns are {names}")
    if len(found) > 3:
        raise InputError(f"{listed}: the readings are in two units; keep one")
    if len({name.rpartition("_")[2] for name in found}) > 1:
        raise InputError(f"{listed} {DIFFERENT_UNITS}")
    gravity = stated_gravity(comments, str(path))
    to_g = unit_in_g(found[0].rpartition("_")[2], gravity)
    return Raw(path, empty, np.zeros((0, 3)), (found[0], found[1], found[2]), to_g, comments, gravity)


def column_names(path: Path) -> list[str]:
    """The names in the header of a table, from its first lines; none if there is no header."""
    if path.suffix == ".parquet":
        return scan_parquet(path, check=False)[0].collect_schema().names()
    with opened(path) as file:
        lines, comments = parted(file.read(1 << 16).decode("utf-8-sig", "replace").splitlines())
    try:
        return list(layout_of_lines(path, lines, comments).names)
    except InputError:
        # The fault is reported when the table is read.
        return [lines[0][1]] if lines else []
