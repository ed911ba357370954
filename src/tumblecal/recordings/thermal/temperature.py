"""The course of a recorded temperature: of blocks, without noise and resolution of the thermometer, in branches and soaks.

Smoothing: the temperature and its rate at an instant are those of a straight line, fitted over the shortest window around it
(powers of two) in which the line changes by four resolution steps and by eight of its standard deviations. The window stops
growing if the line no longer fits, as at a turning point.

Branches: a turning point is an extreme from which the temperature later returns by more than a threshold. A soak is a stretch
of time in which the rate is below a fifth of the mean rate of the recording, and in which that mean rate would change the
temperature by one bin or more.
"""

from pathlib import Path

import numpy as np
import polars as pl
from scipy import ndimage, signal, special

from tumblecal.capture.decoding.samples import Floats, Integers
from tumblecal.data.parquet import scan_parquet
from tumblecal.recordings.own_tables import check_temperatures
from tumblecal.recordings.still.blocks import SignalBlocks, without_single_outliers


# Temperature, degC, and its rate, degC/s.
TEMPERATURE, RATE = "temperature_degc", "rate_degc_per_s"
# Cells of equal length in time over a whole recording, at most.
_CELLS = 1 << 16
# Change of the line over its window: in resolution steps, and in its standard deviations.
_STEPS, _SIGNIFICANT = 4.0, 8.0
# The line does not fit if the variance of the residuals exceeds this multiple of the usual one, and by chance only with this
# probability; longest window, share of all.
_MISFIT, _FALSE_ALARM, _LONGEST = 4.0, 1e-7, 1 / 8
# Half window (cells) from whose residuals the noise is estimated.
_NOISE_HALF = 4
# Share of the steps between successive temperatures that are smaller than the resolution.
_SMALL_STEPS = 0.1
# A thermometer is stuck in a run of equal readings that is this many times as long as the longest by chance, if its noise
# exceeds its resolution: this share of the readings outside the run reverses the direction of the last change.
_STUCK, _NOISY = 5.0, 0.1
# Return of the temperature at a turning point: in bins, in resolution steps and in standard deviations of the noise.
_RETURN_BINS, _RETURN_STEPS, _RETURN_SD = 3.0, 3.0, 6.0
# Rate of a soak as a share of the mean rate.
_SOAK_RATE = 0.2
_WORDS = np.array(["constant", "up", "down"])


def block_temperatures(path: Path, samples: Path, blocks: SignalBlocks) -> tuple[Floats, Floats]:
    """Mean temperature of each block, and its first reading, degC; NaN where unknown.

    **Arguments:** `path`: the recording, for faults. `samples`: its table of samples.

    **Raises:** `InputError` for temperatures in kelvin, and for impossible ones.
    """
    degc = scan_parquet(samples, check=False)[0].select(TEMPERATURE).collect().to_series().to_numpy()
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


def stuck_words(first: Floats, time_s: Floats) -> list[str]:
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


def resolution_of(degc: Floats) -> float:
    """The smallest usual step between successive different readings of a thermometer, degC; 0 if they are all equal."""
    steps = np.abs(np.diff(degc[np.isfinite(degc)]))
    steps = steps[steps > 0]
    return float(np.quantile(steps, _SMALL_STEPS)) if len(steps) else 0.0


def smoothed(time_s: Floats, degc: Floats, resolution: float) -> tuple[pl.DataFrame, float, float]:
    """The smoothed temperature on cells of equal length in time (columns `time_s`, the middle of a cell, `temperature_degc`,
    `rate_degc_per_s`); the length of a cell, s; and the standard deviation of the readings about it, degC.

    **Arguments:** `time_s`, `degc` (readings): increasing times, s, and mean temperatures, degC. `resolution`: of single
    readings, degC.
    """
    count = min(len(time_s), _CELLS)
    cell_s = float(time_s[-1] - time_s[0]) / max(count - 1, 1)
    if count < 3 or not cell_s > 0:
        return pl.DataFrame({"time_s": time_s[:1], TEMPERATURE: [degc.mean()], RATE: [0.0]}), np.inf, 0.0
    middles = time_s[0] + cell_s * np.arange(count)
    cell = np.round((time_s - time_s[0]) / cell_s).astype(int)
    samples = np.bincount(cell, minlength=count)
    filled = samples > 0
    mean = np.bincount(cell, degc, minlength=count)[filled] / samples[filled]
    cells = np.interp(middles, middles[filled], mean)
    longest = max(1, int(count * _LONGEST / 2))
    halves = [1 << k for k in range(longest.bit_length())]
    usual = float(np.median(_line(cells, min(_NOISE_HALF, halves[-1]))[2])) + resolution**2 / 12
    smooth, rate = cells.copy(), np.gradient(cells)
    growing = np.ones(count, bool)
    for half in halves:
        mean, slope, variance = _line(cells, half)
        width = 2 * half + 1
        limit = max(_MISFIT, special.chdtri(width - 2, _FALSE_ALARM) / (width - 2))
        fits = growing & ((variance <= limit * usual) | (half == halves[0]))
        smooth[fits], rate[fits] = mean[fits], slope[fits]
        change = np.abs(slope) * width
        sd = np.sqrt(12 / width * np.maximum(variance, usual))
        growing = fits & ~((change >= _STEPS * resolution) & (change >= _SIGNIFICANT * sd))
        if not growing.any():
            break
    return pl.DataFrame({"time_s": middles, TEMPERATURE: smooth, RATE: rate / cell_s}), cell_s, float(np.sqrt(usual))


def _line(cells: Floats, half: int) -> tuple[Floats, ...]:
    """Mean, slope for one cell, and variance of the residuals of straight lines over `half` cells on both sides of each; at the
    ends the course is continued by its point reflection."""
    level = cells.mean()
    padded = np.pad(cells - level, half, mode="reflect", reflect_type="odd")
    k = np.arange(-half, half + 1)
    width = len(k)
    same = np.full(width, 1 / width)
    # The squares are about a local level, so that they do not cancel.
    mean, slope, square = (
        signal.oaconvolve(values, weights[::-1], mode="valid")
        for values, weights in ((padded, same), (padded, k / (k**2).sum()), (padded**2, same))
    )
    variance = np.maximum(square - mean**2 - slope**2 * (k**2).mean(), 0.0) * width / max(width - 2, 1)
    return mean + level, slope, variance


def stretches_of_temperature(
    degc: Floats, bin_degc: float, resolution: float = 0.0, noise: float = 0.0
) -> tuple[Integers, Integers]:
    """The number of the monotonic stretch of each temperature, and its sign: +1, -1, or 0 if nothing changes.

    **Arguments:** `bin_degc`: width of the bins. `resolution`, `noise`: of the temperatures, degC.
    """
    threshold = max(_RETURN_BINS * bin_degc, _RETURN_STEPS * resolution, _RETURN_SD * noise)
    turns, sign = list[int](), 0
    lowest = highest = 0
    for k, value in enumerate(degc.tolist()):
        lowest = k if value < degc[lowest] else lowest
        highest = k if value > degc[highest] else highest
        if sign >= 0 and degc[highest] - value > threshold:
            turns.append(highest)
            sign, lowest = -1, k
        elif sign <= 0 and value - degc[lowest] > threshold:
            turns.append(lowest)
            sign, highest = 1, k
    # The first extreme is no turning point: what precedes it belongs to the first stretch.
    stretch = np.searchsorted(np.array(turns[1:], int), np.arange(len(degc)), side="left")
    return stretch, sign * (-1) ** (max(len(turns) - 1, 0) - stretch)


def branches(stretch: Integers, sign: Integers, soak: Integers) -> pl.DataFrame:
    """The branch of each temperature; a whole soak is on the stretch by which it was reached.

    Columns: `stretch`, `soak` (-1 for none), `direction` and `reached_by` as of `ThermalTable`, and `branch`, such as `1 up`.

    **Arguments:** `stretch`, `sign`: as of `stretches_of_temperature`. `soak`: its number; -1 for none.
    """
    _, first, group = np.unique(soak, return_index=True, return_inverse=True)
    in_soak = soak >= 0
    at = np.where(in_soak, first[group], np.arange(len(soak)))
    columns = {
        "stretch": stretch[at],
        "soak": soak,
        "direction": np.where(in_soak, 0, sign),
        "reached_by": np.where(in_soak & (at == 0), 0, sign[at]),
    }
    return pl.DataFrame(columns).with_columns(
        branch=pl.format("{} {}", pl.col("stretch") + 1, pl.Series(_WORDS[sign[at]]))
    )


def branches_of_course(
    course: pl.DataFrame, cell_s: float, resolution: float, noise: float, bin_degc: float
) -> pl.DataFrame:
    """A smoothed temperature with the columns of `branches`, for bins of this width, degC; others: as of `smoothed`."""
    degc = course[TEMPERATURE].to_numpy()
    stretch, sign = stretches_of_temperature(degc, bin_degc, resolution, noise)
    soak = np.zeros_like(stretch)
    if sign.any():
        edges = np.append(np.flatnonzero(np.diff(stretch, prepend=-1)), len(degc) - 1)
        mean_rate = float(np.abs(np.diff(degc[edges])).sum()) / (cell_s * len(degc))
        least = max(3, round(bin_degc / mean_rate / cell_s))
        # A thermostat's cycle is averaged over half of the least length.
        rate = ndimage.uniform_filter1d(course[RATE].to_numpy(), max(1, least // 2), mode="nearest")
        slow = np.abs(rate) < _SOAK_RATE * mean_rate
        run = np.cumsum(slow & np.diff(slow, prepend=False))
        soak = np.where(slow & (np.bincount(run, slow) >= least)[run], run, -1)
    return course.hstack(branches(stretch, sign, soak))
