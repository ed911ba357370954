"""A recording in blocks of a tenth of a second: means, scatter, single outliers; memory grows with the blocks only."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tumblecal.data.parquet import scan_parquet


# A longer step of time, or one backwards, is a gap: no interval goes across it.
LONGEST_STEP_S = 0.5
_PIECE_ROWS = 1 << 18
# A sample this many sd beside the median of itself and its neighbours is an outlier of its own.
_OUTLIER_SD = 10.0
# Lower quartile of |x - median of three| of white noise of sd 1, of those that are not zero.
_QUARTILE = 0.32


@dataclass(frozen=True)
class Blocks:
    """Blocks of `size` samples of the accelerations and, where there are any, the angular rates.

    **Arguments:**

    - `mean`, `squares` (blocks, channels): mean, and sum of the squared deviations from it; outliers replaced.
    - `start_s` (blocks): time of the first sample. `broken` (blocks): whether a gap lies in or just before it.
    - `quantum` (channels): smallest step of the numbers. `outliers`: rows of the samples that stand alone.
    - `largest`, `smallest` (3): of the accelerations, in `unit` (g, mg or ms2).
    """

    size: int
    rate_hz: float
    rows: int
    mean: NDArray[np.float64]
    squares: NDArray[np.float64]
    start_s: NDArray[np.float64]
    broken: NDArray[np.bool_]
    quantum: NDArray[np.float64]
    outliers: NDArray[np.int64]
    largest: NDArray[np.float64]
    smallest: NDArray[np.float64]
    unit: str

    def __len__(self) -> int:
        return len(self.mean)


def pieces_of(path: Path, columns: list[str], rows: int = _PIECE_ROWS) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """First row and numbers (n, columns) of each piece of a Parquet table."""
    table, whole, _ = scan_parquet(path, check=False)
    for first in range(0, whole, rows):
        yield first, table.slice(first, rows).select(columns).collect().to_numpy().astype(float)


def blocks_of(path: Path, channels: list[str], rate_hz: float, *, timed: bool) -> Blocks:
    """The blocks of a table of samples.

    **Arguments:**

    - `channels`: columns, the three accelerations first. `timed`: whether there is a column `time_s`.
    """
    size = max(4, round(rate_hz / 10))
    parts: list[tuple[NDArray, ...]] = []
    outliers: list[NDArray[np.int64]] = []
    quantum, last_s, rows = np.full(len(channels), np.inf), np.nan, 0
    for first, table in pieces_of(path, [*channels, *(["time_s"] if timed else [])], _PIECE_ROWS // size * size):
        signal = table[:, : len(channels)]
        times = table[:, -1] if timed else (first + np.arange(len(signal))) / rate_hz
        rows += len(signal)
        quantum = np.minimum(quantum, _smallest_steps(signal))
        extremes = signal[:, :3].max(0), signal[:, :3].min(0)
        signal, alone = _without_outliers(signal)
        outliers.append(first + np.flatnonzero(alone))
        steps = np.diff(times, prepend=last_s if np.isfinite(last_s) else times[0])
        last_s = times[-1]
        count = len(signal) // size
        cut = signal[: count * size].reshape(count, size, signal.shape[1])
        mean = cut.mean(1)
        squares = ((cut - mean[:, None]) ** 2).sum(1)
        gap = np.any(((steps < 0) | (steps > LONGEST_STEP_S))[: count * size].reshape(count, size), axis=1)
        parts.append((mean, squares, times[: count * size : size], np.asarray(gap), *map(np.atleast_2d, extremes)))
    mean, squares, start_s, broken, largest, smallest = (np.concatenate(column) for column in zip(*parts, strict=True))
    extremes = largest.max(0), smallest.min(0)
    quantum[~np.isfinite(quantum)] = 0.0
    unit = channels[0].rpartition("_")[2]
    return Blocks(
        size, rate_hz, rows, mean, squares, start_s, broken, quantum, np.concatenate(outliers), *extremes, unit
    )


def _smallest_steps(signal: NDArray[np.float64]) -> NDArray[np.float64]:
    """The smallest difference between values that occur, by channel."""
    steps = []
    for column in signal[:50000].T:
        between = np.diff(np.unique(column))
        steps.append(between.min() if len(between) else np.inf)
    return np.array(steps)


def _without_outliers(signal: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """The signal with samples that stand alone put to the median of three, and which rows these are."""
    alone = np.zeros(len(signal), bool)
    if len(signal) < 3:
        return signal, alone
    cleaned = signal.copy()
    for column in range(signal.shape[1]):
        values = signal[:, column]
        before, own, after = values[:-2], values[1:-1], values[2:]
        middle = np.maximum(np.minimum(before, own), np.minimum(np.maximum(before, own), after))
        beside = np.abs(own - middle)
        moved = beside[beside > 0]
        if not len(moved):
            continue
        out = beside > _OUTLIER_SD * np.quantile(moved[:50000], 0.25) / _QUARTILE
        cleaned[1:-1, column][out] = middle[out]
        if column < 3:
            alone[1:-1] |= out
    return cleaned, alone
