"""Temperatures of the blocks of a recording: sums in one pass over its samples, in pieces of any length."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tumblecal.data.conditions import are_kelvin, temperature_faults
from tumblecal.ground.errors import InputError
from tumblecal.recordings.still.blocks import SignalBlocks, pieces_of, without_single_outliers


COLUMN = "temperature_degc"
# A temperature that is missing for at most this time is interpolated, s.
_LONGEST_MISSING_S = 60.0
# A thermometer is stuck in a run of equal readings that is this many times as long as the longest by chance, if its noise
# exceeds its resolution: this share of the readings outside the run reverses the direction of the last change.
_STUCK, _NOISY = 5.0, 0.1


class BlockTemperatures:
    """Sums of the temperatures of blocks; pieces of any length give the same sums.

    **Arguments:**

    - `row` (blocks): first sample of each block. `size`: samples of a block.
    """

    def __init__(self, row: NDArray[np.int64], size: int):
        self.row = row
        self.size = size
        self.total = np.zeros(len(row))
        self.known = np.zeros(len(row), int)
        # The first reading of each block, from which the resolution of the thermometer follows.
        self.first = np.full(len(row), np.nan)

    def add(self, start: int, degc: NDArray[np.float64]) -> None:
        """Add the temperatures of the rows from `start` on; NaN where unknown."""
        low = max(int(np.searchsorted(self.row, start, side="right")) - 1, 0)
        high = int(np.searchsorted(self.row, start + len(degc)))
        if low >= high:
            return
        rows = np.arange(start, start + len(degc))
        block = np.searchsorted(self.row[low:high], rows, side="right") - 1
        inside = (block >= 0) & np.isfinite(degc)
        inside[inside] &= rows[inside] < self.row[low + block[inside]] + self.size
        at = block[inside]
        self.total[low:high] += np.bincount(at, degc[inside], minlength=high - low)
        self.known[low:high] += np.bincount(at, minlength=high - low)
        begun = self.row[low:high]
        here = (begun >= start) & (begun < start + len(degc))
        self.first[low:high][here] = degc[begun[here] - start]

    @property
    def mean(self) -> NDArray[np.float64]:
        """Mean temperature of each block, degC; NaN for a block without one."""
        return np.where(self.known > 0, self.total / np.maximum(self.known, 1), np.nan)


def block_temperatures(
    path: Path, samples: Path, blocks: SignalBlocks
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean temperature of each block, and its first reading, degC; NaN where unknown.

    **Arguments:**

    - `path`: the recording, for faults. `samples`: its table of samples.

    **Raises:** `InputError` for temperatures in kelvin, and for impossible ones.
    """
    return temperatures_of(path, blocks, (piece[:, 0] for _, piece in pieces_of(samples, [COLUMN])))


def temperatures_of(
    path: Path, blocks: SignalBlocks, pieces: Iterable[NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """As `block_temperatures`, from the temperatures of all rows in pieces."""
    sums = BlockTemperatures(blocks.row, blocks.size)
    start = 0
    for degc in pieces:
        sums.add(start, degc)
        start += len(degc)
    mean = sums.mean
    known = np.flatnonzero(np.isfinite(mean))
    if not len(known):
        raise InputError(f"{path}: no temperature is a number; give the column by --columns temperature=...")
    mean[known] = without_single_outliers(mean[known, None])[0][:, 0]
    if are_kelvin(mean[known]):
        raise InputError(
            f"{path}: temperatures {mean[known].min():.4g} to {mean[known].max():.4g} are in kelvin; write degC, or give a "
            "column in degC by --columns temperature=..."
        )
    for at, fault in temperature_faults(mean[known]):
        raise InputError(f"{path}:row {int(blocks.row[known[at]]) + 1}: temperature {fault}")
    return mean, sums.first


def stuck_readings(first: NDArray[np.float64]) -> tuple[int, int] | None:
    """The longest run (first, last + 1) of equal readings of a thermometer, if it is stuck there; None if it is not, or if its
    noise is below its resolution, so that equal readings are usual."""
    known = np.flatnonzero(np.isfinite(first))
    if len(known) < 3:
        return None
    steps = np.diff(first[known])
    starts = np.flatnonzero(np.append(True, steps != 0))
    lengths = np.diff(np.append(starts, len(known)))
    k = int(np.argmax(lengths))
    changes = np.sign(steps[steps != 0])
    reversing = np.count_nonzero(np.diff(changes)) / max(len(known) - int(lengths[k]), 1)
    if reversing < _NOISY or lengths[k] <= _STUCK * np.log(len(known)) / reversing:
        return None
    return int(known[starts[k]]), int(known[starts[k] + lengths[k] - 1]) + 1


def without_short_gaps(time_s: NDArray[np.float64], degc: NDArray[np.float64]) -> NDArray[np.float64]:
    """Temperatures with missing ones interpolated between known ones if these are within a minute of each other."""
    known = np.flatnonzero(np.isfinite(degc))
    after = np.searchsorted(known, np.arange(len(degc))).clip(0, len(known) - 1)
    before = np.maximum(after - 1, 0)
    near = time_s[known[after]] - time_s[known[before]] <= _LONGEST_MISSING_S
    # Before the first and after the last known temperature nothing is interpolated.
    within = (np.arange(len(degc)) >= known[0]) & (np.arange(len(degc)) <= known[-1])
    filled = np.where(near & within, np.interp(time_s, time_s[known], degc[known]), np.nan)
    return np.where(np.isfinite(degc), degc, filled)
