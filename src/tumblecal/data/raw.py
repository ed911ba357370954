"""Raw readings of any length: the three axes' columns read, corrected and written back, all else kept."""

import io
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from tumblecal.data.files import stated
from tumblecal.data.parquet import read_parquet
from tumblecal.ground.atomic import written_aside
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError, one_line
from tumblecal.ground.gravity import (
    SOURCE_KEY,
    STANDARD,
    UNITS,
    VALUE_KEY,
    Gravity,
    comments_of,
    stated_gravity,
    unit_in_g,
)
from tumblecal.ground.text_file import read_text, shown


if TYPE_CHECKING:
    import polars as pl

CORRECTED_BY = "corrected_by"
# Numbers beyond are no reading and would overflow the sums of squares.
LARGEST_G = 1e6


@dataclass(frozen=True)
class Raw:
    """A table with readings.

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

    def in_g_of(self, gravity: Gravity | None) -> "Raw":
        """The same readings in the g of a calibration; as they are where it, or a file in g or mg, does not say which."""
        own = self.gravity or (STANDARD if self.in_ms2 else None)
        if gravity is None or own is None:
            return self
        ratio = own.in_g_of(gravity)
        return replace(self, readings=self.readings * ratio, to_g=self.to_g * ratio, gravity=gravity)

    @property
    def in_ms2(self) -> bool:
        """Whether the columns are in m/s^2."""
        return self.columns[0].endswith("_ms2")

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
    if path.suffix == ".parquet":
        frame, comments = read_parquet(path)
        lines, first_line = [f"# {key}: {value}" for key, value in comments.items()], 1
    else:
        frame, lines, first_line = _csv(path)
        comments = stated(lines)
    if CORRECTED_BY in comments:
        raise InputError(f"{path}: these data are corrected already ({CORRECTED_BY}); give the raw file")
    columns = _axis_columns(path, frame.columns)
    unit, gravity = columns[0].rsplit("_", 1)[1], stated_gravity(comments, str(path))
    to_g = unit_in_g(unit, gravity)
    readings = np.stack([_column(path, frame, name, first_line) for name in columns], axis=-1) * to_g
    row, axis = np.unravel_index(np.argmax(np.abs(readings)), readings.shape) if readings.size else (0, 0)
    if readings.size and abs(readings[row, axis]) > LARGEST_G:
        cell = f"{path}:line {first_line + int(row)}, column {columns[axis]}"
        raise InputError(f"{cell}: {readings[row, axis]:.3g} g is no reading; remove the row")
    return Raw(path, frame, readings, columns, to_g, comments, tuple(lines), gravity, first_line)


def _csv(path: Path) -> tuple["pl.DataFrame", list[str], int]:
    """Table, comment lines wherever they stand, and line of the first row."""
    import polars as pl

    lines = read_text(path).splitlines()
    header = next((number for number, line in enumerate(lines) if line.strip() and not line.startswith("#")), None)
    if header is None:
        raise InputError(f"{path}: no header line; the first line names the columns")
    body = "\n".join(line for line in lines[header:] if not line.startswith("#"))
    try:
        frame = pl.read_csv(io.StringIO(body), infer_schema=False)
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, ValueError) as error:
        raise InputError(f"{path}: not a CSV table ({(str(error).splitlines() or ['damaged'])[0]})") from error
    return frame, [line for line in lines if line.startswith("#")], header + 2


def write_raw(
    path: Path, raw: Raw, corrected: Float[np.ndarray, "rows 3"], note: str, local: Gravity | None = None
) -> None:
    """Write the table with its readings replaced by `corrected` (g; written in the file's own unit).

    **Arguments:**

    - `note`: what corrected it. `local`: the gravity that one g of the written columns is, where it is stated.
    """
    import polars as pl

    frame = raw.frame.with_columns(
        [
            pl.Series(name, values if path.suffix == ".parquet" else [repr(float(v)) for v in values])
            for name, values in zip(raw.columns, (corrected / raw.to_g).T, strict=True)
        ]
    )
    with written_aside(path) as aside:
        if path.suffix == ".parquet":
            more = comments_of(local) if local else {}
            frame.write_parquet(aside, metadata=raw.comments | more | {CORRECTED_BY: note})
        else:
            with aside.open("w", encoding="utf-8", newline="\n") as out:
                own = [line for line in raw.lines if not (local and stated([line]).keys() & {VALUE_KEY, SOURCE_KEY})]
                local_lines = [f"# {key}: {value}" for key, value in comments_of(local).items()] if local else []
                out.writelines(f"{line}\n" for line in (*own, *local_lines, f"# {CORRECTED_BY}: {one_line(note)}"))
                frame.write_csv(out)


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
