"""Tables of a source, as every format returns them: with the column names of the source, in pieces of any length."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tumblecal.capture.recordings.damage import Damage
from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.data.parquet import PIECE_ROWS
from tumblecal.data.text_layout import ROW
from tumblecal.ground.errors import InputError
from tumblecal.ground.plain_text import first_control, plain


if TYPE_CHECKING:
    import polars as pl


@dataclass(frozen=True)
class SourceTable:
    """A table of a source: a topic of a bag, a variable of a file, a sheet.

    **Arguments:**

    - `name`: name in the source; empty for a single table. `columns`: names of the columns in the source.
    - `pieces`: the rows of these columns, in order, with the column `ROW` if rows have numbers in the source.
    - `rows`: number of rows; None if they would have to be read.
    - `roles`: quantities that the format defines: `{"linear_acceleration.x": "ax_ms2"}`.
    - `per_unit`: steps of a column of counts for one g (`a`) or one deg/s (`g`), if the format defines it.
    - `comments`: other statements of the source, `key: value`. `row_word`: name of a row in a fault.
    - `header`: the line with the names of the columns, from 1; None if they are elsewhere.
    - `sheet`: whether it is the only table of a file, with named columns; a corrected copy then retains all columns.
    - `as_written`: of a text, the table with these columns as numbers and all others as they are written, except for decimal
      commas; numbers would lose leading zeros, and the last digits of long counters.
    - `zero_s`: the clock of the source, s, at time zero of the column of times; known after rows were read.
    """

    name: str
    columns: tuple[str, ...]
    pieces: Callable[[Sequence[str]], Iterator["pl.DataFrame"]]
    rows: int | None = None
    roles: Mapping[str, str] = field(default_factory=dict)
    per_unit: Mapping[str, float] = field(default_factory=dict)
    comments: Mapping[str, str] = field(default_factory=dict)
    description: str = ""
    row_word: str = "row"
    header: int | None = None
    sheet: bool = False
    as_written: "Callable[[Collection[str]], SourceTable] | None" = None
    zero_s: Callable[[], float] = lambda: 0.0

    def __post_init__(self) -> None:
        # A recording may have any text: it is stored with escapes, and columns whose names have control characters cannot
        # be given by name.
        comments = {plain(str(key)): plain(str(value)) for key, value in self.comments.items()}
        columns = tuple(name for name in self.columns if name == ROW or first_control(name) is None)
        cleaned = {
            "comments": comments,
            "columns": columns,
            "name": plain(self.name),
            "description": plain(self.description),
        }
        for name, value in cleaned.items():
            object.__setattr__(self, name, value)

    def place(self, path: str) -> str:
        """Place of the names of the columns, for a fault."""
        return path if self.header is None else f"{path}:{self.row_word} {self.header}"


class Source(NamedTuple):
    """A file or folder, the options for it, and its damage, to which its format and its rows add."""

    path: Path
    options: RecordingOptions
    damage: Damage


@dataclass(frozen=True)
class Reader:
    """A format.

    **Arguments:**

    - `title`: name for messages. `recognises`: whether a path and its first 64 kB have this format.
    - `read`: the tables of a source; damage is reported if sound rows remain, now or while the rows are read. `rank`:
      formats of higher rank are tried later.
    """

    title: str
    recognises: Callable[[Path, bytes], bool]
    read: Callable[[Source], list[SourceTable]]
    rank: int = 0


def library(name: str, path: Path) -> ModuleType:
    """Import a library that only some formats need.

    **Raises:** `InputError` with the package to install.
    """
    try:
        return import_module(name)
    except ImportError:
        package = name.partition(".")[0]
        raise InputError(
            f"{path}: reading this file needs the package {package}; install it with: pip install 'tumblecal[recordings]'"
        ) from None


def of_arrays(name: str, arrays: Mapping[str, np.ndarray], **more) -> SourceTable:
    """A table of columns (n,) of equal length in memory."""

    def pieces(columns: Sequence[str]) -> Iterator["pl.DataFrame"]:
        import polars as pl

        for first in range(0, rows, PIECE_ROWS):
            yield pl.DataFrame({column: arrays[column][first : first + PIECE_ROWS] for column in columns})

    rows = len(next(iter(arrays.values())))
    return SourceTable(name, tuple(arrays), pieces, rows, **more)


def tables_of_arrays(arrays: Mapping[str, np.ndarray], **more) -> list[SourceTable]:
    """Tables of the arrays of a file: arrays of one folder (`a/b` and `a/c`) and one length form a table.

    A matrix (n, k) or (k, n) of up to 32 columns gives columns `name[0]`, `name[1]` ...; wider arrays, arrays with more
    dimensions and arrays without numbers are ignored.
    """
    groups: dict[tuple[str, int], dict[str, np.ndarray]] = {}
    for name, given in arrays.items():
        values = np.squeeze(np.asarray(given))
        if values.dtype.kind not in "iufbU" or values.ndim not in (1, 2):
            continue
        matrix = values[:, None] if values.ndim == 1 else values if values.shape[0] >= values.shape[1] else values.T
        if matrix.shape[1] > 32:
            continue
        named = [name] if values.ndim == 1 else [f"{name}[{k}]" for k in range(matrix.shape[1])]
        folder = name.rpartition("/")[0]
        group = groups.setdefault((folder, len(matrix)), {})
        group |= {path.rpartition("/")[2]: np.ascontiguousarray(matrix[:, k]) for k, path in enumerate(named)}
    folders = [folder for folder, _ in groups]
    return [
        of_arrays(folder if folders.count(folder) == 1 else f"{folder}[{rows}]", columns, **more)
        for (folder, rows), columns in groups.items()
    ]
