"""A table of a recording under the names of its source, read in pieces; and a format, which finds the tables of a file."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tumblecal.data.parquet import PIECE_ROWS
from tumblecal.data.text_layout import ROW
from tumblecal.ground.errors import InputError
from tumblecal.ground.plain_text import first_control, plain
from tumblecal.recordings.damage import Damage
from tumblecal.recordings.options import RecordingOptions


if TYPE_CHECKING:
    import polars as pl

# An array with more columns is an image or a spectrum.
_MOST_COLUMNS = 32


@dataclass(frozen=True)
class Table:
    """A table of a source: a topic of a bag, a variable of a file, a sheet, the rows of a text.

    **Arguments:**

    - `name`: in the source; empty for a single table. `columns`: names in the source, in order.
    - `pieces`: the rows of some of these columns, in order, with the column `ROW` if rows have numbers in the source.
    - `rows`: number of rows; None if they would have to be read.
    - `roles`: quantities that the format defines, with their units: `{"linear_acceleration.x": "ax_ms2"}`.
    - `per_unit`: counts for one g (`a`) or one deg/s (`g`), if the format defines them.
    - `stated`: other statements of the source, `key: value`. `words`: the table in words.
    - `row_word`: what a row is called in a fault.
    - `sheet`: whether it is the only table of a file, with named columns; a corrected copy then retains all columns.
    - `zero_s`: the clock of the source, s, at time zero; known after reading.
    """

    name: str
    columns: tuple[str, ...]
    pieces: Callable[[Sequence[str]], Iterator["pl.DataFrame"]]
    rows: int | None = None
    roles: Mapping[str, str] = field(default_factory=dict)
    per_unit: Mapping[str, float] = field(default_factory=dict)
    stated: Mapping[str, str] = field(default_factory=dict)
    words: str = ""
    row_word: str = "row"
    sheet: bool = False
    zero_s: Callable[[], float] = lambda: 0.0

    def plain(self) -> "Table":
        """The table with control characters of its texts escaped, and without columns whose names have some."""
        columns = tuple(name for name in self.columns if name == ROW or first_control(name) is None)
        stated = {plain(str(key)): plain(str(value)) for key, value in self.stated.items()}
        return replace(self, name=plain(self.name), columns=columns, stated=stated, words=plain(self.words))


class Source(NamedTuple):
    """A file or folder, the options for it, and its damage, to which its format and its rows add."""

    path: Path
    options: RecordingOptions
    damage: Damage


@dataclass(frozen=True)
class Reader:
    """A format.

    **Arguments:**

    - `title`: for messages. `recognises`: whether a path and its first 64 kB have this format.
    - `read`: the tables of a source; damage is reported if sound rows remain, now or while the rows are read.
    - `rank`: formats of higher rank are tried later.
    """

    title: str
    recognises: Callable[[Path, bytes], bool]
    read: Callable[[Source], list[Table]]
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


def of_arrays(name: str, arrays: Mapping[str, np.ndarray], **more) -> Table:
    """A table of columns (n,) of equal length in memory; `more`: further fields of `Table`."""
    rows = len(next(iter(arrays.values())))

    def pieces(columns: Sequence[str]) -> Iterator["pl.DataFrame"]:
        import polars as pl

        for first in range(0, rows, PIECE_ROWS):
            yield pl.DataFrame({column: arrays[column][first : first + PIECE_ROWS] for column in columns})

    return Table(name, tuple(arrays), pieces, rows, **more)


def tables_of_arrays(arrays: Mapping[str, np.ndarray], **more) -> list[Table]:
    """Tables of the arrays of a file: arrays of one folder (`a/b` and `a/c`) and one length form a table.

    A matrix (n, k) or (k, n) of up to 32 columns gives columns `name[0]`, `name[1]` ...; wider arrays, arrays with more
    dimensions and arrays without numbers are ignored.
    """
    groups: dict[tuple[str, int], dict[str, np.ndarray]] = {}
    for path, given in arrays.items():
        values = np.squeeze(np.asarray(given))
        folder, _, name = path.rpartition("/")
        if values.dtype.kind not in "iufbU" or values.ndim not in (1, 2):
            continue
        if values.ndim == 1:
            groups.setdefault((folder, len(values)), {})[name] = values
            continue
        matrix = values if values.shape[0] >= values.shape[1] else values.T
        if matrix.shape[1] <= _MOST_COLUMNS:
            columns = {f"{name}[{k}]": np.ascontiguousarray(column) for k, column in enumerate(matrix.T)}
            groups.setdefault((folder, len(matrix)), {}).update(columns)
    folders = [folder for folder, _ in groups]
    return [
        of_arrays(folder if folders.count(folder) == 1 else f"{folder}[{rows}]", columns, **more)
        for (folder, rows), columns in groups.items()
    ]
