"""Raw readings of any length: tables with the three axes' columns, whole or a piece at a time, all else kept."""

import csv
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from tumblecal.data.files import stated
from tumblecal.data.parquet import PARQUET_ROWS, PIECE_ROWS, pieces_in_order, scan_parquet
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import (
    STANDARD,
    UNITS,
    Gravity,
    stated_gravity,
    unit_in_g,
)
from tumblecal.ground.text_file import read_comments, shown


if TYPE_CHECKING:
    import polars as pl

CORRECTED_BY = "corrected_by"
# Numbers beyond are no reading and would overflow the sums of squares.
LARGEST_G = 1e6


@dataclass(frozen=True)
class Raw:
    """A table with readings, or a piece of it.

    `frame` as it stands in the file; `readings` in g, from `columns`, one unit of which is `to_g`; `comments` as stated;
    `gravity` is what one g of the readings is, None where the file does not say; `first_line` is that of the first row.
    """

    path: Path
    frame: "pl.DataFrame"
    readings: Float[np.ndarray, "rows 3"]
    columns: tuple[str, str, str]
    to_g: float
    comments: dict[str, str]
    lines: tuple[str, ...]
    gravity: Gravity | None
    first_line: int

    def with_rows(self, frame: "pl.DataFrame", before: int = 0) -> "Raw":
        """The rows of a piece, of which `before` stand ahead in the file.

        **Raises:** `InputError` naming the first cell that is no reading.
        """
        first = self.first_line + before
        # Axis by axis in memory, as the columns come and go.
        readings = np.stack([_column(self.path, frame, name, first) for name in self.columns]).T
        readings = readings if self.to_g == 1 else readings * self.to_g
        if readings.size and not (np.max(readings) <= LARGEST_G and np.min(readings) >= -LARGEST_G):
            row, axis = np.unravel_index(np.argmax(np.abs(readings)), readings.shape)
            cell = f"{self.path}:line {first + int(row)}, column {self.columns[axis]}"
            raise InputError(f"{cell}: {readings[row, axis]:.3g} g is no reading; remove the row")
        return replace(self, frame=frame, readings=readings, first_line=first)

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

    def numbers(self, name: str) -> Float[np.ndarray, " rows"]:
        """A column of finite numbers.

        **Raises:** `InputError` naming the first cell that is none.
        """
        return _column(self.path, self.frame, name, self.first_line)

    def temperature_degc(self) -> Float[np.ndarray, " rows"] | None:
        """The column of that name, if there is one."""
        return self.numbers("temperature_degc") if "temperature_degc" in self.frame.columns else None


def read_raw(path: Path) -> Raw:
    """Read a CSV or Parquet table with columns `ax_g, ay_g, az_g` (or `_mg`, `_ms2`) among others.

    **Raises:** `InputError` for a file without them, already corrected, or with a cell that is no finite number.
    """
    header, table = opened_raw(path)
    with _table_faults(path):
        frame = table.collect()
    return header.with_rows(frame)


def opened_raw(path: Path) -> tuple[Raw, "pl.LazyFrame"]:
    """What such a table states, without its rows, and the rows, not read yet.

    **Raises:** `InputError` for a file without the columns, or already corrected.
    """
    if path.suffix == ".parquet":
        table, _, comments = scan_parquet(path)
        lines, first_line = [f"# {key}: {value}" for key, value in comments.items()], 1
    else:
        table, lines, first_line = _csv(path)
        comments = stated(lines)
    with _table_faults(path):
        empty = table.head(0).collect()
    return header_of(path, empty, comments, lines, first_line), table


def header_of(
    path: Path, empty: "pl.DataFrame", comments: dict[str, str], lines: Sequence[str] = (), first_line: int = 1
) -> Raw:
    """What a table states whose columns are those of `empty`.

    **Raises:** as `opened_raw`.
    """
    if CORRECTED_BY in comments:
        raise InputError(f"{path}: these data are corrected already ({CORRECTED_BY}); give the raw file")
    columns = _axis_columns(path, empty.columns)
    unit, gravity = columns[0].rpartition("_")[2], stated_gravity(comments, str(path))
    to_g = unit_in_g(unit, gravity)
    return Raw(path, empty, np.zeros((0, 3)), columns, to_g, comments, tuple(lines), gravity, first_line)


def frames_of(path: Path, table: "pl.LazyFrame") -> Iterator["pl.DataFrame"]:
    """The rows of a table in order, some hundred thousand at a time; those of an empty one are one empty piece."""
    with _table_faults(path):
        yield from pieces_in_order(table, PARQUET_ROWS if path.suffix == ".parquet" else PIECE_ROWS)


def column_names(path: Path) -> list[str]:
    """The names in a table's header, as far as its first lines tell; none of what has none."""
    if path.suffix == ".parquet":
        return scan_parquet(path)[0].collect_schema().names()
    with path.open("rb") as file:
        lines = file.read(1 << 16).decode("utf-8-sig", "replace").splitlines()
    header = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    return [name.strip() for name in next(csv.reader([header]), [])]


def readings_among(names: Sequence[str]) -> bool:
    """Whether these are columns of a table of readings."""
    return any(all(f"a{axis}_{unit}" in names for axis in AXES) for unit in UNITS)


def _csv(path: Path) -> tuple["pl.LazyFrame", list[str], int]:
    """Table, comment lines wherever they stand, and line of the first row."""
    import polars as pl

    at, comments = read_comments(path)
    with path.open("rb") as file:
        beginning = file.read(1 << 16)
    # Of old systems: lines that end in carriage returns alone.
    end = "\r" if b"\r" in beginning and b"\n" not in beginning else "\n"
    table = pl.scan_csv(path, infer_schema=False, skip_lines=at, comment_prefix="#", glob=False, eol_char=end)
    return table, comments, at + 2


@contextmanager
def _table_faults(path: Path) -> Iterator[None]:
    import polars as pl

    try:
        yield
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, ValueError) as error:
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
    there = shown(", ".join(names))
    raise InputError(f"{path}: columns ax_g, ay_g, az_g (or _mg, _ms2) are missing; it has {there}")


def _column(path: Path, frame: "pl.DataFrame", name: str, first_line: int) -> np.ndarray:
    import polars as pl

    column = frame[name]
    if not (column.dtype.is_numeric() or column.dtype == pl.String):
        raise InputError(f"{path}: column {name}: holds {column.dtype}, not numbers; write numbers")
    cells = column.str.strip_chars() if column.dtype == pl.String else column
    values = cells.cast(pl.Float64, strict=False).to_numpy()
    bad = np.nonzero(~np.isfinite(values))[0]
    if len(bad):
        more = f" ({len(bad)} such cells)" if len(bad) > 1 else ""
        raise InputError(
            f"{path}:line {first_line + int(bad[0])}, column {name}: {shown(column[int(bad[0])])} is not a finite number; "
            f"remove the row{more}"
        )
    return values
