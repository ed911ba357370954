"""What every format gives: tables whose columns have the source's own names, in pieces of any length."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from tumblecal.capture.corrected_text import TextCells
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

    - `name`: in the source; empty where it has but one. `columns`: their names there.
    - `pieces`: the rows of these columns, in order, and the column `ROW` where rows have a place of their own.
    - `rows`: how many there are; None where counting means reading.
    - `roles`: what columns are for sure, by the format's own rules: `{"linear_acceleration.x": "ax_ms2"}`.
    - `per_unit`: how many steps of a column of counts are one g (`a`) or one deg/s (`g`), where the format says so.
    - `comments`: what else the source states, `key: value`. `row_word`: what a row is called in a fault.
    - `header`: the line that names the columns, from 1; None where they are named elsewhere.
    - `text`: how the cells of text with such a line are written. `sheet`: whether it is a table of named columns in a file of
      its own, all of which a corrected copy keeps.
    - `zero_s`: the source's clock, s, where the column of times is zero; known once rows were read.
    """

    name: str
    columns: tuple[str, ...]
    pieces: Callable[[Sequence[str]], Iterator["pl.DataFrame"]]
    rows: int | None = None
    roles: Mapping[str, str] = field(default_factory=dict)
    per_unit: Mapping[str, float] = field(default_factory=dict)
    comments: Mapping[str, str] = field(default_factory=dict)
    said: str = ""
    row_word: str = "row"
    header: int | None = None
    text: TextCells | None = None
    sheet: bool = False
    zero_s: Callable[[], float] = lambda: 0.0

    def __post_init__(self) -> None:
        # A recording may state anything: texts are kept with escapes, and columns whose names have control characters cannot
        # be asked for by them.
        comments = {plain(str(key)): plain(str(value)) for key, value in self.comments.items()}
        columns = tuple(name for name in self.columns if name == ROW or first_control(name) is None)
        own = {"comments": comments, "columns": columns, "name": plain(self.name), "said": plain(self.said)}
        for name, value in own.items():
            object.__setattr__(self, name, value)

    def place(self, path: str) -> str:
        """Where the names of the columns stand, for a fault."""
        return path if self.header is None else f"{path}:{self.row_word} {self.header}"


@dataclass(frozen=True)
class Reader:
    """A format.

    **Arguments:**

    - `title`: for people. `recognises`: whether a path, and its first 64 kB, are of it.
    - `read`: the tables of a source, with what the user says of it; damage that leaves sound rows is reported, now or while
      the rows are read. `rank`: formats of a higher one are asked later.
    """

    title: str
    recognises: Callable[[Path, bytes], bool]
    read: Callable[[Path, RecordingOptions, Damage], list[SourceTable]]
    rank: int = 0


def library(name: str, path: Path) -> ModuleType:
    """A library that only some formats need.

    **Raises:** `InputError` saying what to install.
    """
    try:
        return import_module(name)
    except ImportError:
        package = name.partition(".")[0]
        raise InputError(
            f"{path}: reading it takes the package {package}; install it with: pip install 'tumblecal[recordings]'"
        ) from None


def of_arrays(name: str, arrays: Mapping[str, np.ndarray], **more) -> SourceTable:
    """A table of columns (n,) of equal length that are in memory."""

    def pieces(columns: Sequence[str]) -> Iterator["pl.DataFrame"]:
        import polars as pl

        for first in range(0, rows, PIECE_ROWS):
            yield pl.DataFrame({column: arrays[column][first : first + PIECE_ROWS] for column in columns})

    rows = len(next(iter(arrays.values())))
    return SourceTable(name, tuple(arrays), pieces, rows, **more)


def tables_of_arrays(arrays: Mapping[str, np.ndarray], **more) -> list[SourceTable]:
    """Tables of the arrays of a file: those of one folder (`a/b` and `a/c`) and one length make one.

    A matrix (n, k) or (k, n) of up to 32 columns gives columns `name[0]`, `name[1]` ...; what is longer, has more
    dimensions or is no number is left out.
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
        group |= {own.rpartition("/")[2]: np.ascontiguousarray(matrix[:, k]) for k, own in enumerate(named)}
    folders = [folder for folder, _ in groups]
    return [
        of_arrays(folder if folders.count(folder) == 1 else f"{folder}[{rows}]", columns, **more)
        for (folder, rows), columns in groups.items()
    ]
