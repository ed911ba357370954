"""The course of a recorded temperature without the noise and the resolution of its thermometer, with its rate.

Rule: the temperature and its rate at an instant are those of a straight line, fitted over the shortest window around it (powers
of two) in which the line changes by four resolution steps and by eight of its standard deviations. The window stops growing if
the line no longer fits, as at a turning point.
"""

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy import signal, special


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


def smoothed(
    time_s: NDArray[np.float64], degc: NDArray[np.float64], resolution: float
) -> tuple[pl.DataFrame, float, float]:
    """The smoothed temperature on cells of equal length in time (columns `time_s`, the middle of a cell, `temperature_degc`,
    `rate_degc_per_s`); the length of a cell, s; and the standard deviation of the readings about it, degC.

    **Arguments:** `time_s`, `degc` (readings): increasing times, s, and mean temperatures, degC. `resolution`: of single
    readings, degC.
    """
    count = min(len(time_s), _CELLS)
    cell_s = float(time_s[-1] - time_s[0]) / max(count - 1, 1)
    if count < 3 or not cell_s > 0:
        return (
            pl.DataFrame({"time_s": time_s[:1], "temperature_degc": [degc.mean()], "rate_degc_per_s": [0.0]}),
            np.inf,
            0.0,
        )
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
    course = {"time_s": middles, "temperature_degc": smooth, "rate_degc_per_s": rate / cell_s}
    return pl.DataFrame(course), cell_s, float(np.sqrt(usual))


def resolution_of(degc: NDArray[np.float64]) -> float:
    """The smallest usual step between successive different readings of a thermometer, degC; 0 if they are all equal."""
    steps = np.abs(np.diff(degc[np.isfinite(degc)]))
    steps = steps[steps > 0]
    return float(np.quantile(steps, _SMALL_STEPS)) if len(steps) else 0.0


def _line(cells: NDArray[np.float64], half: int) -> tuple[NDArray[np.float64], ...]:
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
