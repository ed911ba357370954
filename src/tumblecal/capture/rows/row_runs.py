"""Runs of equal rows in a recording, found in one pass over its samples on disk; memory use is a few bytes a row."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.capture.columns.units import Column
from tumblecal.capture.still.blocks import pieces_of
from tumblecal.data.text_layout import ROW


TIME = "time_s"
# Fewest rows with equal readings and clock (if there is one) that are erased memory.
FEWEST_ERASED = 20
_RISING = 0.9


@dataclass(frozen=True)
class RowRuns:
    """Comparison of each row with the row before.

    **Arguments:**

    - `same_force`, `same`, `same_time` (rows): whether the accelerations, all readings, the time equal those of the row before.
    - `path`, `channels`: of the samples, the three accelerations first; `timed`: whether they have times.
    - `backward`: number of steps of time backwards. `size`: median size of the accelerations, equal rows counted once.
    - `scale`, `offset`: a reading is `scale (number - offset)` for a number of the source. `rate_hz`: rows a second.
    """

    path: Path
    channels: Sequence[str]
    timed: bool
    same_force: NDArray[np.bool_]
    same: NDArray[np.bool_]
    same_time: NDArray[np.bool_]
    backward: int
    size: float
    scale: NDArray[np.float64]
    offset: NDArray[np.float64]
    rate_hz: float | None

    def __len__(self) -> int:
        return len(self.same)

    def times(self) -> NDArray[np.float64]:
        """The times of all rows, s."""
        return np.concatenate([piece[:, 0] for _, piece in pieces_of(self.path, [TIME])])

    def rows_at(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """The readings and the time (NaN without one) of some rows, in rising order."""
        columns = [*self.channels, *([TIME] if self.timed else [])]
        parts = [np.zeros((0, len(columns)))]
        for first, piece in pieces_of(self.path, columns):
            parts.append(piece[rows[(rows >= first) & (rows < first + len(piece))] - first])
        whole = np.concatenate(parts)
        return whole if self.timed else np.column_stack([whole, np.full(len(whole), np.nan)])


def runs_of(flags: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First row and number of rows of each run of rows that equal the row before; single rows are runs of one."""
    starts = np.flatnonzero(~flags)
    return starts, np.diff(np.append(starts, len(flags)))


def without_erased_rows(first: pl.DataFrame) -> pl.DataFrame:
    """The first rows of a source without erased memory, before the quantities of its columns are known.

    Erased are rows in which all columns stop, if a column rises in nearly all others (a clock) or all cells are one number.
    """
    cells = first.select(pl.exclude(ROW))
    numbers = cells.select(pl.all().cast(pl.Float64, strict=False)).to_numpy()
    if len(numbers) < FEWEST_ERASED:
        return first
    # A clock that continues shows nothing.
    stays = np.flatnonzero(np.mean(np.diff(numbers, axis=0) > 0, axis=0) <= _RISING)
    cells, numbers = cells[:, stays.tolist()], numbers[:, stays]
    if len(stays) < 3:
        return first
    equal = cells.select(pl.all_horizontal(pl.all().eq_missing(pl.all().shift(1)))).to_series().to_numpy().copy()
    equal[:1] = False
    lengths = runs_of(equal)[1]
    if lengths.max() < FEWEST_ERASED:
        return first
    long = np.repeat(lengths >= FEWEST_ERASED, lengths)
    others = np.diff(numbers[~long], axis=0)
    clock = len(others) > 0 and bool((np.mean(others > 0, axis=0) > _RISING).any())
    erased = long if clock else long & (numbers == numbers[:, :1]).all(1)
    return first if erased.all() else first.filter(~erased)


def row_runs(
    path: Path,
    channels: Sequence[str],
    *,
    timed: bool,
    columns: Sequence[Column],
    rate_hz: float | None,
    look: Callable[[NDArray[np.float64]], None] = lambda force: None,
) -> RowRuns:
    """The runs of equal rows of a table of samples.

    **Arguments:**

    - `channels`: columns, the three accelerations first. `timed`: whether there is a column `time_s`.
    - `columns`: the accelerations in the source. `rate_hz`: rows a second, None if unknown.
    - `look`: called with the accelerations of each piece.
    """
    parts: list[tuple[NDArray[np.bool_], ...]] = []
    sizes: list[NDArray[np.float64]] = []
    before: NDArray[np.float64] | None = None
    backward = 0
    for _, piece in pieces_of(path, [*channels, *([TIME] if timed else [])]):
        if not len(piece):
            continue
        equal = np.empty(piece.shape, bool)
        equal[1:] = piece[1:] == piece[:-1]
        equal[0] = False if before is None else piece[0] == before
        readings = equal[:, : len(channels)]
        same_force = np.all(readings[:, :3], axis=1)
        same_time = equal[:, -1] if timed else np.zeros(len(piece), bool)
        parts.append((same_force, np.all(readings, axis=1), same_time))
        if timed:
            times = piece[:, -1] if before is None else np.append(before[-1], piece[:, -1])
            backward += int(np.count_nonzero(np.diff(times) < 0))
        sizes.append(np.linalg.norm(piece[~same_force, :3][::32], axis=1))
        look(piece[:, :3])
        before = piece[-1].copy()
    same_force, same, same_time = (np.concatenate(column) for column in zip(*parts, strict=True))
    size = float(np.median(np.concatenate(sizes)))
    scale, offset = np.array([(column.scale, column.offset) for column in columns]).T
    return RowRuns(path, channels, timed, same_force, same, same_time, backward, size, scale, offset, rate_hz)
