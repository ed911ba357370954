"""The course of a recorded temperature without the noise and the resolution of its thermometer, with its rate.

Rule: the temperature and its rate at an instant are those of a straight line, fitted over the shortest window around it (powers
of two) in which the line changes by four resolution steps and by eight of its standard deviations. The window stops growing if
the line no longer fits, as at a turning point.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
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


@dataclass(frozen=True)
class TemperatureCourse:
    """The smoothed temperature on cells of equal length in time.

    - `time_s`, `degc`, `rate` (cells): middle of each cell, s; temperature, degC; its rate, degC/s.
    - `resolution`: smallest usual step of the thermometer, degC. `noise`: standard deviation of its readings about the line.
    """

    time_s: Float[np.ndarray, " cells"]
    degc: Float[np.ndarray, " cells"]
    rate: Float[np.ndarray, " cells"]
    resolution: float
    noise: float

    @property
    def cell_s(self) -> float:
        """Length of a cell, s."""
        return float(self.time_s[1] - self.time_s[0]) if len(self.time_s) > 1 else 0.0

    @property
    def span(self) -> float:
        """Highest minus lowest temperature, degC."""
        return float(np.ptp(self.degc))

    def at(self, time_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Temperature, degC, and rate, degC/s, at some times."""
        return np.interp(time_s, self.time_s, self.degc), np.interp(time_s, self.time_s, self.rate)


def temperature_course(time_s: NDArray[np.float64], degc: NDArray[np.float64], resolution: float) -> TemperatureCourse:
    """Smooth a temperature.

    **Arguments:**

    - `time_s`, `degc` (blocks): increasing times, s, and mean temperatures, degC. `resolution`: of single readings, degC.
    """
    count = int(np.clip(len(time_s), 1, _CELLS))
    length = float(time_s[-1] - time_s[0])
    if count < 3 or not length > 0:
        return TemperatureCourse(time_s[:1], degc[:1] * 0 + degc.mean(), degc[:1] * 0.0, resolution, 0.0)
    cell_s = length / (count - 1)
    middles = time_s[0] + cell_s * np.arange(count)
    cell = np.round((time_s - time_s[0]) / cell_s).astype(int)
    samples = np.bincount(cell, minlength=count)
    filled = samples > 0
    mean = np.bincount(cell, degc, minlength=count)[filled] / samples[filled]
    cells = np.interp(middles, middles[filled], mean)
    smooth, slope, noise = _by_lines(cells, resolution)
    return TemperatureCourse(middles, smooth, slope / cell_s, resolution, noise)


def resolution_of(degc: NDArray[np.float64]) -> float:
    """The smallest usual step between successive different readings of a thermometer, degC; 0 if they are all equal."""
    steps = np.abs(np.diff(degc[np.isfinite(degc)]))
    steps = steps[steps > 0]
    return float(np.quantile(steps, _SMALL_STEPS)) if len(steps) else 0.0


def _by_lines(cells: NDArray[np.float64], resolution: float) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Temperature and change for one cell by the rule of this module, and the noise."""
    count = len(cells)
    longest = max(1, int(count * _LONGEST / 2))
    halves = [1 << k for k in range(longest.bit_length()) if 1 << k <= longest]
    noise_half = min(_NOISE_HALF, halves[-1])
    usual = float(np.median(_line(cells, noise_half)[2])) + resolution**2 / 12
    degc, rate = cells.copy(), np.gradient(cells)
    growing = np.ones(count, bool)
    for half in halves:
        mean, slope, variance = _line(cells, half)
        width = 2 * half + 1
        limit = max(_MISFIT, special.chdtri(width - 2, _FALSE_ALARM) / (width - 2))
        fits = growing & ((variance <= limit * usual) | (half == halves[0]))
        degc[fits], rate[fits] = mean[fits], slope[fits]
        change = np.abs(slope) * width
        sd = np.sqrt(12 / width * np.maximum(variance, usual))
        growing = fits & ~((change >= _STEPS * resolution) & (change >= _SIGNIFICANT * sd))
        if not growing.any():
            break
    return degc, rate, float(np.sqrt(usual))


def _line(cells: NDArray[np.float64], half: int) -> tuple[NDArray[np.float64], ...]:
    """Mean, slope for one cell, and variance of the residuals of straight lines over `half` cells on both sides of each; at the
    ends the course is continued by its point reflection."""
    level = cells.mean()
    padded = np.pad(cells - level, half, mode="reflect", reflect_type="odd")
    k = np.arange(-half, half + 1)
    width = len(k)
    mean = _filtered(padded, np.full(width, 1 / width))
    slope = _filtered(padded, k / (k**2).sum())
    # About a local level, so that the squares do not cancel.
    square = _filtered(padded**2, np.full(width, 1 / width))
    variance = np.maximum(square - mean**2 - slope**2 * (k**2).mean(), 0.0) * width / max(width - 2, 1)
    return mean + level, slope, variance


def _filtered(padded: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(signal.oaconvolve(padded, weights[::-1], mode="valid"))
