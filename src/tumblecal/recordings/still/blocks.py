"""A recording in blocks of a tenth of a second: means, scatter, single outliers; memory grows only with the blocks.

The blocks of recordings of more than a day are longer, so that their number is bounded.

Blocks restart at each cut of the recording: at a gap of its times, and at a join, where recordings at rest follow each other
without the movement between them. At a join the mean jumps from one sample to the next and is steady on both sides.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tumblecal.data.parquet import scan_parquet
from tumblecal.recordings.clock import LONGEST_STEP_S


# Logs whose steps are longer than `LONGEST_STEP_S` do not show movements; their gaps are longer than this many of their
# steps, and their blocks have this many samples, others at least `_SAMPLES`.
_SLOW_STEPS, _SLOW_SAMPLES, _SAMPLES = 3, 2, 4
_PIECE_ROWS = 1 << 18
# Most blocks: 29 hours of a tenth of a second.
_MOST_BLOCKS = 1 << 20
# A sample that differs by this many standard deviations from the median of itself and its neighbours is a single outlier.
_OUTLIER_SD = 10.0
# Lower quartile of the non-zero |x - median of three| of white noise with standard deviation 1.
_QUARTILE = 0.32
# No accelerometer has coarser steps than this share of gravity (8 bits, 16 g).
_COARSEST = 0.15
# A join: the means of this many samples before and after it differ by this many standard deviations of a sample, and by this
# share of it from one sample to the next.
_JOIN_SAMPLES, _JOIN_SD, _AT_ONCE = (8, 16), 5.0, 0.5
# Number of rows of a piece from which its steps and its noise are estimated.
_SAMPLED_ROWS = 50000


@dataclass(frozen=True)
class SignalBlocks:
    """Blocks of `size` samples of the accelerations and of the angular rates, if there are any.

    **Arguments:**

    - `mean`, `squares` (blocks, channels): mean, and sum of the squared deviations from it; outliers replaced.
    - `row`, `start_s` (blocks): number and time of the first sample. `broken` (blocks): whether the recording is cut just
      before it; `cuts`: the rows of the cuts, and the end of the recording.
    - `quantum` (channels): smallest step of the numbers. `outliers`: rows of single outliers.
    - `ends` (2, blocks, 3): largest and smallest acceleration of each block, in `unit` (g, mg or ms2). `at_ends`
      (2, blocks, 3): number of samples with this value.
    """

    size: int
    rate_hz: float
    rows: int
    mean: NDArray[np.float64]
    squares: NDArray[np.float64]
    row: NDArray[np.int64]
    start_s: NDArray[np.float64]
    broken: NDArray[np.bool_]
    cuts: NDArray[np.int64]
    quantum: NDArray[np.float64]
    outliers: NDArray[np.int64]
    ends: NDArray[np.float64]
    at_ends: NDArray[np.int64]
    unit: str

    def __len__(self) -> int:
        return len(self.mean)

    def stop_row(self, block: int) -> int:
        """The row after a block; for the last block before a cut, the row of the cut."""
        if block + 1 < len(self) and not self.broken[block + 1]:
            return int(self.row[block + 1])
        return int(self.cuts[np.searchsorted(self.cuts, self.row[block], side="right")])


def pieces_of(path: Path, columns: list[str], rows: int = _PIECE_ROWS) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """First row and numbers (n, columns) of each piece of a Parquet table."""
    table, whole, _ = scan_parquet(path, check=False)
    for first in range(0, whole, rows):
        yield first, table.slice(first, rows).select(columns).collect().to_numpy().astype(float)


def stretches_of(starts: NDArray, lengths: NDArray, step: int = 1) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The rows of stretches from `starts` on, of `lengths` rows each at distances of `step`; their numbers in the stretch."""
    number = np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    return np.repeat(starts, lengths) + step * number, number


def blocks_of(path: Path, channels: list[str], rate_hz: float, *, timed: bool) -> SignalBlocks:
    """The blocks of a table of samples.

    **Arguments:**

    - `channels`: columns, the three accelerations first. `timed`: whether there is a column `time_s`.
    """
    rows = scan_parquet(path, check=False)[1]
    fewest, longest_s = _SAMPLES, LONGEST_STEP_S
    if rate_hz * LONGEST_STEP_S < 1:
        fewest, longest_s = _SLOW_SAMPLES, _SLOW_STEPS / rate_hz
    size = max(fewest, round(rate_hz / 10), -(-rows // _MOST_BLOCKS))
    width = min(max(size, _JOIN_SAMPLES[0]), _JOIN_SAMPLES[1])
    parts: list[tuple[NDArray, ...]] = []
    outliers: list[NDArray[np.int64]] = []
    cuts: list[NDArray[np.int64]] = []
    quantum = np.full(len(channels), np.inf)
    # Rows from `base` on wait for later rows; blocks are complete up to `begin`, where a cut may be.
    waiting, base, begin, cut = np.zeros((0, len(channels) + timed)), 0, 0, False
    for first, piece in pieces_of(path, [*channels, *(["time_s"] if timed else [])]):
        table = np.concatenate([waiting, piece])
        signal = table[:, : len(channels)]
        quantum = np.minimum(quantum, _smallest_steps(piece[:, : len(channels)]))
        signal, alone = without_single_outliers(signal)
        limit = len(table) - (0 if first + len(piece) == rows else width)
        joins = _joins(signal[:, :3], _quantum(quantum, signal)[0], width)
        steps = np.diff(table[:, -1]) if timed else np.zeros(0)
        gaps = np.flatnonzero((steps < 0) | (steps > longest_s)) + 1
        inside = np.union1d(joins, gaps)
        inside = inside[(inside >= begin - base) & (inside < limit)]
        starts = np.concatenate([[begin - base], inside]).astype(int)
        lengths = (np.append(starts[1:], max(limit, begin - base)) - starts) // size
        at, number = stretches_of(starts, lengths, size)
        broken = number == 0
        broken[: lengths[0]] = broken[: lengths[0]] & cut
        parts.append(
            (*_block_values(signal, at, size), at + base, table[at, -1] if timed else (at + base) / rate_hz, broken)
        )
        cuts.append(inside + base)
        outliers.append(base + np.flatnonzero(alone[:limit]))
        begin, cut = int(base + starts[-1] + lengths[-1] * size), bool(not lengths[-1] and (cut or len(inside)))
        keep = max(begin - base - width, 0)
        waiting, base = table[keep:], base + keep
    mean, squares, ends, at_ends, row, start_s, broken = (
        np.concatenate(column, axis=1 if column[0].ndim == 3 else 0) for column in zip(*parts, strict=True)
    )
    return SignalBlocks(
        size,
        rate_hz,
        rows,
        mean,
        squares,
        row,
        start_s,
        broken,
        np.unique(np.append(np.concatenate(cuts), rows)),
        _quantum(quantum, mean),
        np.unique(np.concatenate(outliers)),
        ends,
        at_ends,
        channels[0].rpartition("_")[2],
    )


def _block_values(signal: NDArray[np.float64], at: NDArray[np.int64], size: int) -> tuple[NDArray, ...]:
    """Means, squares, ends and numbers of samples at the ends, for blocks that begin at some rows."""
    whole = len(at) and at[-1] - at[0] == size * (len(at) - 1)
    cut = signal[at[0] : at[-1] + size].reshape(len(at), size, -1) if whole else signal[at[:, None] + np.arange(size)]
    mean = cut.mean(1)
    force = cut[:, :, :3]
    ends = np.stack([force.max(1), force.min(1)])
    at_ends = np.stack([(force == end[:, None]).sum(1) for end in ends])
    deviation = cut - mean[:, None]
    return mean, np.einsum("ijk,ijk->ik", deviation, deviation), ends, at_ends


def _joins(force: NDArray[np.float64], quantum: float, width: int) -> NDArray[np.int64]:
    """The rows at which the mean of the accelerations jumps, steady for `beside` samples before and after."""
    if len(force) < 2 * width + 1:
        return np.zeros(0, int)
    steps = np.diff(force, axis=0)
    # The median of such differences is 0.95 of the sd of a sample.
    usual = (np.maximum(np.median(np.abs(steps[:_SAMPLED_ROWS]), axis=0), quantum) ** 2).sum()
    steps = np.einsum("ij,ij->i", steps, steps)
    large = steps > (_AT_ONCE * _JOIN_SD) ** 2 * usual
    rows = np.flatnonzero(large & (steps == ndimage.maximum_filter1d(steps, width + 1))) + 1
    rows = rows[(rows >= width) & (rows <= len(force) - width)]
    before, after = (force[rows[:, None] + np.arange(k, k + width)] for k in (-width, 0))
    variance = (before.var(1, ddof=1) + after.var(1, ddof=1)) / 2
    variance = np.maximum(variance, quantum**2 / 12)
    moved = ((after.mean(1) - before.mean(1)) ** 2).sum(1)
    at_once = steps[rows - 1] > _AT_ONCE**2 * moved
    return rows[at_once & (moved > _JOIN_SD**2 * np.maximum(variance.sum(1), 1e-300))]


def _smallest_steps(signal: NDArray[np.float64]) -> NDArray[np.float64]:
    """The smallest difference between distinct values, by channel."""
    steps = []
    for column in signal[:_SAMPLED_ROWS].T:
        between = np.diff(np.unique(column))
        steps.append(between.min() if len(between) else np.inf)
    return np.array(steps)


def _quantum(steps: NDArray[np.float64], readings: NDArray[np.float64]) -> NDArray[np.float64]:
    """The smallest step of the numbers, by channel: one step for the accelerations, and one for the rates, since one axis may
    have few distinct numbers; 0 if unknown because there are too few."""
    size = np.median(np.linalg.norm(readings[:_SAMPLED_ROWS, :3], axis=1)) if len(readings) else 0.0
    force, rate = steps[:3].min(), steps[3:].min(initial=np.inf)
    force = force if force < _COARSEST * size else 0.0
    return np.concatenate([np.full(3, force), np.full(len(steps) - 3, rate if np.isfinite(rate) else 0.0)])


def without_single_outliers(signal: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """The signal with single outliers replaced by the median of three, and their rows."""
    alone = np.zeros(len(signal), bool)
    if len(signal) < 3:
        return signal, alone
    cleaned = signal.copy()
    for column in range(signal.shape[1]):
        values = signal[:, column]
        before, centre, after = values[:-2], values[1:-1], values[2:]
        middle = np.maximum(np.minimum(before, centre), np.minimum(np.maximum(before, centre), after))
        deviation = np.abs(centre - middle)
        moved = deviation[deviation > 0]
        if not len(moved):
            continue
        out = deviation > _OUTLIER_SD * np.quantile(moved[:_SAMPLED_ROWS], 0.25) / _QUARTILE
        cleaned[1:-1, column][out] = middle[out]
        if column < 3:
            alone[1:-1] |= out
    return cleaned, alone
