"""Raw readings of any length: the three axes' columns read, corrected and written back, all else kept."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from tumblecal.data.atomic import written_aside
from tumblecal.data.columns import STANDARD_GRAVITY, UNITS
from tumblecal.data.files import read_text
from tumblecal.data.positions import AXES
from tumblecal.errors import InputError


if TYPE_CHECKING:
    import polars as pl

CORRECTED_BY = "corrected_by"


@dataclass(frozen=True)
class Raw:
    """A table with readings: `frame` as it stands in the file, `readings` in g, and the columns they came from."""

    frame: "pl.DataFrame"
    readings: Float[np.ndarray, "rows 3"]
    columns: tuple[str, str, str]
    to_g: float
    comments: tuple[str, ...]


def read_raw(path: Path) -> Raw:
    """Read a CSV or Parquet table with columns `ax_g, ay_g, az_g` (or `_mg`, `_ms2`) among others.

    **Raises:** `InputError` for a file without them, already corrected, or with a cell that is no finite number.
    """
    import io

    import polars as pl

    comments: list[str] = []
    first_line = 2
    if path.suffix == ".parquet":
        if not path.exists():
            raise InputError(f"{path}: no such file")
        try:
            frame = pl.read_parquet(path)
            comments = [f"# {k}: {v}" for k, v in pl.read_parquet_metadata(path).items() if not k.startswith("ARROW")]
        except (pl.exceptions.PolarsError, OSError) as error:
            raise InputError(f"{path}: not a Parquet file ({str(error).splitlines()[0]})") from error
    else:
        text = read_text(path)
        lines = text.splitlines()
        while lines and (lines[0].startswith("#") or not lines[0].strip()):
            comments.append(lines.pop(0))
            first_line += 1
        body = "\n".join(lines)
        try:
            frame = pl.read_csv(io.StringIO(body), infer_schema=False, comment_prefix="#")
        except pl.exceptions.PolarsError as error:
            raise InputError(f"{path}: not a CSV table ({str(error).splitlines()[0]})") from error
    if any(comment.lstrip("# ").startswith(CORRECTED_BY) for comment in comments):
        raise InputError(f"{path}: these data are corrected already ({CORRECTED_BY}); give the raw file")
    columns = _axis_columns(path, frame.columns)
    unit = columns[0].rsplit("_", 1)[1]
    to_g = {"g": 1.0, "mg": 1e-3, "ms2": 1.0 / STANDARD_GRAVITY}[unit]
    readings = np.stack([_column(path, frame, name, first_line) for name in columns], axis=-1) * to_g
    return Raw(frame, readings, columns, to_g, tuple(comments))


def write_raw(path: Path, raw: Raw, corrected: Float[np.ndarray, "rows 3"], note: str) -> None:
    """Write the table with its readings replaced by `corrected` (g; written in the file's own unit)."""
    import polars as pl

    frame = raw.frame.with_columns(
        [
            pl.Series(name, values if path.suffix == ".parquet" else [repr(float(v)) for v in values])
            for name, values in zip(raw.columns, (corrected / raw.to_g).T, strict=True)
        ]
    )
    lines = [*raw.comments, f"# {CORRECTED_BY}: {note}"]
    with written_aside(path) as aside:
        if path.suffix == ".parquet":
            pairs = (line.lstrip("# ").partition(":") for line in lines if ":" in line)
            frame.write_parquet(aside, metadata={key.strip(): value.strip() for key, _, value in pairs})
        else:
            with aside.open("w", encoding="utf-8", newline="\n") as out:
                out.writelines(f"{line}\n" for line in lines if line.strip())
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
    raise InputError(f"{path}: columns ax_g, ay_g, az_g (or _mg, _ms2) are missing; it has {', '.join(names)}")


def _column(path: Path, frame: "pl.DataFrame", name: str, first_line: int) -> np.ndarray:
    import polars as pl

    column = frame[name]
    cells = column.str.strip_chars() if column.dtype == pl.String else column
    values = cells.cast(pl.Float64, strict=False).to_numpy()
    bad = np.nonzero(~np.isfinite(values))[0]
    if len(bad):
        more = f" ({len(bad)} such cells)" if len(bad) > 1 else ""
        raise InputError(
            f"{path}:line {first_line + int(bad[0])}, column {name}: {column[int(bad[0])]!r} is not a finite number; "
            f"remove the row{more}"
        )
    return values
