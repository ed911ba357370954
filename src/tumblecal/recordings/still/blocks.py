"""A recording in blocks of a tenth of a second: means, scatter, single outliers; memory grows only with the blocks.

The blocks of recordings of more than a day are longer, so that their number is bounded.

Blocks restart at each cut of the recording: at a gap of its times, and at a join, where recordings at rest follow each other
without the movement between them. At a join the mean jumps from one sample to the next and is steady on both sides.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tumblecal.capture.decoding.samples import Floats, Integers
from tumblecal.data.parquet import scan_parquet
from tumblecal.recordings.clock import LONGEST_STEP_S


# Logs whose steps are longer than `LONGEST_STEP_S` do not show movements; their gaps are longer than this many of their
# steps, and their blocks have this many samples, others at least `_SAMPLES`.
SLOW_STEPS, _SLOW_SAMPLES, _SAMPLES = 3, 2, 4
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
      before it. `stop` (blocks): the row after it; for the last block before a cut, the row of the cut.
    - `cuts`: the rows of the cuts, and the number of rows. `outliers`: rows of single outliers.
    - `quantum` (channels): smallest step of the numbers.
    - `ends` (blocks, 6): the largest accelerations of each block, and the largest negative ones, in `unit` (g, mg or ms2);
      `at_ends`: number of samples with this value.
    """

    size: int
    rate_hz: float
    rows: int
    mean: Floats
    squares: Floats
    ends: Floats
    at_ends: Integers
    row: Integers
    start_s: Floats
    cuts: Integers
    outliers: Integers
    quantum: Floats
    unit: str

    def __len__(self) -> int:
        return len(self.mean)

    @cached_property
    def _stretch(self) -> Integers:
        return np.searchsorted(self.cuts, self.row, side="right")

    @cached_property
    def broken(self) -> NDArray[np.bool_]:
        """Whether the recording is cut just before each block."""
        return np.diff(self._stretch, prepend=0) > 0

    @cached_property
    def stop(self) -> Integers:
        """The row after each block; for the last block before a cut, the row of the cut."""
        return np.minimum(np.append(self.row[1:], self.rows), self.cuts[self._stretch])


def pieces_of(path: Path, columns: list[str], pad: int = 0) -> Iterator[tuple[slice, slice, Floats]]:
    """The rows of each piece of a Parquet table; their places in the numbers that follow; and these numbers (n, columns), with
    up to `pad` rows before and after the piece."""
    table, whole, _ = scan_parquet(path, check=False)
    for first in range(0, whole, _PIECE_ROWS):
        before, count = min(pad, first), min(_PIECE_ROWS, whole - first)
        rows = table.slice(first - before, before + count + pad).select(columns).collect().to_numpy()
        yield slice(first, first + count), slice(before, before + count), rows.astype(float, copy=False)


def blocks_of(path: Path, channels: list[str], rate_hz: float, *, timed: bool) -> SignalBlocks:
    """The blocks of a table of samples.

    **Arguments:**

    - `channels`: columns, the three accelerations first. `timed`: whether there is a column `time_s`.
    """
    rows, width = scan_parquet(path, check=False)[1], len(channels)
    fewest, longest_s = _SAMPLES, LONGEST_STEP_S
    if rate_hz * LONGEST_STEP_S < 1:
        fewest, longest_s = _SLOW_SAMPLES, SLOW_STEPS / rate_hz
    size = max(fewest, round(rate_hz / 10), -(-rows // _MOST_BLOCKS))
    near = int(np.clip(size, *_JOIN_SAMPLES))
    columns, pad = [*channels, *(["time_s"] if timed else [])], max(size, near)
    cuts, outliers, smallest = list[NDArray](), list[NDArray](), np.full(width, np.inf)
    for piece, inside, table in pieces_of(path, columns, pad):
        # The smallest difference between distinct values, by channel; infinite for a single value.
        sampled = table[inside][:_SAMPLED_ROWS, :width].T
        smallest = np.minimum(smallest, [np.diff(np.unique(column)).min(initial=np.inf) for column in sampled])
        signal, alone = without_single_outliers(table[:, :width])
        found = _joins(signal[:, :3], _quantum(smallest, signal)[0], near)
        if timed:
            steps = np.diff(table[:, -1])
            found = np.union1d(found, np.flatnonzero((steps < 0) | (steps > longest_s)) + 1)
        cuts.append(found[(found >= inside.start) & (found < inside.stop)] - inside.start + piece.start)
        outliers.append(np.flatnonzero(alone[inside]) + piece.start)
    edges = np.unique(np.concatenate([[0], *cuts, [rows]])).astype(int)
    row = np.concatenate([np.arange(a, b - size + 1, size) for a, b in pairwise(edges.tolist())] or [edges[:0]])
    parts = list[tuple[NDArray, ...]]()
    for piece, inside, table in pieces_of(path, columns, pad):
        at = row[(row >= piece.start) & (row < piece.stop)] - piece.start + inside.start
        cut = without_single_outliers(table[:, :width])[0][at[:, None] + np.arange(size)]
        mean, force = cut.mean(1), cut[:, :, :3]
        deviation = cut - mean[:, None]
        high, low = force.max(1), force.min(1)
        at_ends = np.hstack([(force == end[:, None]).sum(1) for end in (high, low)])
        squares = np.einsum("ijk,ijk->ik", deviation, deviation)
        times = table[at, -1] if timed else (at - inside.start + piece.start) / rate_hz
        parts.append((mean, squares, np.hstack([high, -low]), at_ends, times))
    mean, squares, ends, at_ends, start_s = (np.concatenate(column) for column in zip(*parts, strict=True))
    alone, quantum, unit = np.concatenate(outliers), _quantum(smallest, mean), channels[0].rpartition("_")[2]
    return SignalBlocks(
        size, rate_hz, rows, mean, squares, ends, at_ends, row, start_s, edges[1:], alone, quantum, unit
    )


def _joins(force: Floats, quantum: float, width: int) -> Integers:
    """The rows at which the mean of the accelerations jumps, steady for `width` samples before and after."""
    if len(force) < 2 * width + 1:
        return np.zeros(0, int)
    steps = np.diff(force, axis=0)
    # The median of such differences is 0.95 of the sd of a sample.
    usual = (np.median(np.abs(steps[:_SAMPLED_ROWS]), axis=0) ** 2).sum()
    steps = np.einsum("ij,ij->i", steps, steps)
    large = steps > (_AT_ONCE * _JOIN_SD) ** 2 * usual
    rows = np.flatnonzero(large & (steps == ndimage.maximum_filter1d(steps, width + 1))) + 1
    rows = rows[(rows >= width) & (rows <= len(force) - width)]
    before, after = (force[rows[:, None] + np.arange(k, k + width)] for k in (-width, 0))
    variance = np.maximum((before.var(1, ddof=1) + after.var(1, ddof=1)) / 2, quantum**2 / 12)
    moved = ((after.mean(1) - before.mean(1)) ** 2).sum(1)
    at_once = steps[rows - 1] > _AT_ONCE**2 * moved
    return rows[at_once & (moved > _JOIN_SD**2 * np.maximum(variance.sum(1), 1e-300))]


def _quantum(steps: Floats, readings: Floats) -> Floats:
    """The smallest step of the numbers, by channel: one step for the accelerations, and one for the rates, since one axis may
    have few distinct numbers; 0 if unknown because there are too few."""
    size = np.median(np.linalg.norm(readings[:_SAMPLED_ROWS, :3], axis=1)) if len(readings) else 0.0
    force, rate = steps[:3].min(), steps[3:].min(initial=np.inf)
    quantum = np.full(len(steps), force if force < _COARSEST * size else 0.0)
    quantum[3:] = rate if np.isfinite(rate) else 0.0
    return quantum


def without_single_outliers(signal: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """The signal (n, channels) with single outliers replaced by the median of three; mask of the rows with one in the first
    three channels."""
    cleaned, alone = signal.copy(), np.zeros(len(signal), bool)
    for column, values in enumerate(signal.T):
        before, centre, after = values[:-2], values[1:-1], values[2:]
        middle = np.maximum(np.minimum(before, centre), np.minimum(np.maximum(before, centre), after))
        moved = np.abs(centre - middle)
        if (moved > 0).any():
            out = moved > _OUTLIER_SD * np.quantile(moved[moved > 0][:_SAMPLED_ROWS], 0.25) / _QUARTILE
            cleaned[1:-1, column][out] = middle[out]
            alone[1:-1] |= out & (column < 3)
    return cleaned, alone
