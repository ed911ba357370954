"""Temperatures of the blocks of a recording, and faults of its thermometer."""

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


def block_temperatures(
    path: Path, samples: Path, blocks: SignalBlocks
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean temperature of each block, and its first reading, degC; NaN where unknown.

    **Arguments:**

    - `path`: the recording, for faults. `samples`: its table of samples, read once, in pieces.

    **Raises:** `InputError` for temperatures in kelvin, and for impossible ones.
    """
    total, known, first = np.zeros(len(blocks)), np.zeros(len(blocks), int), np.full(len(blocks), np.nan)
    for start, piece in pieces_of(samples, [COLUMN]):
        degc, rows = piece[:, 0], np.arange(start, start + len(piece))
        low = max(int(np.searchsorted(blocks.row, start, side="right")) - 1, 0)
        at = np.searchsorted(blocks.row[low:], rows, side="right") - 1
        place = rows - blocks.row[low + np.maximum(at, 0)]
        inside = (at >= 0) & (place < blocks.size) & np.isfinite(degc)
        sums = np.bincount(at[inside], degc[inside])
        total[low : low + len(sums)] += sums
        known[low : low + len(sums)] += np.bincount(at[inside], minlength=len(sums))
        begun = (at >= 0) & (place == 0)
        first[low + at[begun]] = degc[begun]
    mean = np.where(known > 0, total / np.maximum(known, 1), np.nan)
    measured = np.flatnonzero(known)
    if not len(measured):
        raise InputError(f"{path}: no temperature is a number; give the column by --columns temperature=...")
    mean[measured] = without_single_outliers(mean[measured, None])[0][:, 0]
    if are_kelvin(mean[measured]):
        raise InputError(
            f"{path}: temperatures {mean[measured].min():.4g} to {mean[measured].max():.4g} are in kelvin; write degC, or give "
            "a column in degC by --columns temperature=..."
        )
    for at, fault in temperature_faults(mean[measured]):
        raise InputError(f"{path}:row {int(blocks.row[measured[at]]) + 1}: temperature {fault}")
    return mean, first


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
