"""Temperatures of the blocks of a recording, and faults of its thermometer."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tumblecal.data.parquet import scan_parquet
from tumblecal.recordings.own_tables import check_temperatures
from tumblecal.recordings.still.blocks import SignalBlocks, without_single_outliers


# A thermometer is stuck in a run of equal readings that is this many times as long as the longest by chance, if its noise
# exceeds its resolution: this share of the readings outside the run reverses the direction of the last change.
_STUCK, _NOISY = 5.0, 0.1


def block_temperatures(
    path: Path, samples: Path, blocks: SignalBlocks
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean temperature of each block, and its first reading, degC; NaN where unknown.

    **Arguments:** `path`: the recording, for faults. `samples`: its table of samples.

    **Raises:** `InputError` for temperatures in kelvin, and for impossible ones.
    """
    degc = scan_parquet(samples, check=False)[0].select("temperature_degc").collect().to_series().to_numpy()
    total, count = np.zeros(len(blocks)), np.zeros(len(blocks), int)
    for sample in range(blocks.size):
        reading = degc[blocks.row + sample]
        known = np.isfinite(reading)
        total, count = total + np.where(known, reading, 0.0), count + known
    mean = total / np.where(count, count, np.nan)
    measured = np.flatnonzero(count)
    mean[measured] = without_single_outliers(mean[measured, None])[0][:, 0]
    check_temperatures(mean[measured], str(path), lambda at: f"row {blocks.row[measured[at]] + 1}")
    return mean, degc[blocks.row]


def stuck_words(first: NDArray[np.float64], time_s: NDArray[np.float64]) -> list[str]:
    """A line about the longest run of equal readings of a thermometer, if it is stuck there; none if its noise is below its
    resolution, so that equal readings are usual.

    **Arguments:** `first`, `time_s` (blocks): readings, degC, NaN where unknown; times, s.
    """
    known = np.isfinite(first)
    readings, time_s = first[known], time_s[known]
    edges = np.flatnonzero(np.diff(readings, prepend=np.nan, append=np.nan))
    longest = int(np.argmax(np.diff(edges)))
    start, stop = edges[longest : longest + 2]
    turns = np.count_nonzero(np.diff(np.sign(np.diff(readings[edges[:-1]]))))
    reversing = turns / max(len(readings) - (stop - start), 1)
    if reversing < _NOISY or stop - start <= _STUCK * np.log(len(readings)) / reversing:
        return []
    return [
        f"the thermometer shows exactly {readings[start]:.6g} degC from {time_s[start]:.0f} s to {time_s[stop - 1]:.0f} s, "
        "without the noise of other times: it may be stuck; cut this part out"
    ]
