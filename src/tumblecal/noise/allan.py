"""Overlapping Allan deviation with confidence bands, pooled over dwells.

The estimator and the equivalent degrees of freedom are those of NIST Special Publication 1065 (Riley 2008), section
5; the noise type that the degrees of freedom need is taken from the local slope.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri


# Slopes of log variance below this are those of quantisation noise.
_QUANTISED = -1.5
# Of the band.
_CONFIDENCE = 0.68


@dataclass(frozen=True)
class AllanDeviation:
    """Overlapping Allan deviation of one axis.

    **Arguments:**

    - `tau_s`: averaging times, shape (m,). `deviation`: in the unit of the data.
    - `low`, `high`: confidence band. `dof`: equivalent degrees of freedom.
    """

    tau_s: NDArray[np.float64]
    deviation: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    dof: NDArray[np.float64]


def averaging_factors(n: int, per_octave: int = 2, fewest: int = 3) -> NDArray[np.int64]:
    """Numbers of samples to average over: a geometric series up to a third of the data (`fewest` whole averages)."""
    largest = max(n // fewest, 1)
    octaves = np.log2(largest) if largest > 1 else 0
    return np.unique(np.rint(2.0 ** np.arange(0, octaves + 1e-9, 1 / per_octave)).astype(np.int64))


def _squared_differences(total: NDArray[np.float64], factor: int, room: NDArray[np.float64]) -> tuple[float, int]:
    """Sum of squared second differences of a running sum, and their number; both are pooled over stretches.

    **Arguments:**

    - `total`: running sum of a stretch, from 0. `factor`: samples in an average. `room`: memory for as many numbers.
    """
    n = len(total) - 2 * factor
    if n < 1:
        return 0.0, 0
    difference = np.subtract(total[2 * factor :], total[factor:-factor], out=room[:n])
    difference -= total[factor:-factor]
    difference += total[:n]
    # Not by @: the threads of the linear algebra library would wait for each other.
    return float(np.einsum("i,i", difference, difference)), n


def overlapping_allan(
    stretches: list[NDArray[np.float64]],
    rate_hz: float,
    factors: NDArray[np.int64] | None = None,
) -> AllanDeviation:
    """Overlapping Allan deviation of one axis, pooled over stretches without gaps.

    **Arguments:**

    - `stretches`: data of one axis, each shape (n_k,).
    - `rate_hz`: sample rate.
    - `factors`: samples to average over; a geometric series when None.
    """
    stretches = [s for s in stretches if len(s) >= 3]
    longest = max((len(s) for s in stretches), default=0)
    factors = averaging_factors(longest) if factors is None else factors
    totals = [np.concatenate([[0.0], np.cumsum(s - s.mean())]) for s in stretches]
    room = np.empty(longest + 1)
    variance, dof = [], []
    used_factors = []
    for factor in factors.tolist():
        parts = [_squared_differences(total, factor, room) for total in totals]
        count = sum(c for _, c in parts)
        if not count:
            continue
        used_factors.append(factor)
        variance.append(sum(total for total, _ in parts) / (2.0 * factor**2 * count))
    variance_of = np.array(variance)
    slopes = _slopes(np.array(used_factors), variance_of)
    for factor, slope in zip(used_factors, slopes, strict=True):
        lengths = [len(s) for s in stretches if len(s) >= 2 * factor]
        dof.append(sum(degrees_of_freedom(n, factor, slope) for n in lengths))
    freedom = np.array(dof)
    tail = (1 - _CONFIDENCE) / 2
    deviation = np.sqrt(variance_of)
    return AllanDeviation(
        tau_s=np.array(used_factors) / rate_hz,
        deviation=deviation,
        low=deviation * np.sqrt(freedom / chdtri(freedom, tail)),
        high=deviation * np.sqrt(freedom / chdtri(freedom, 1 - tail)),
        dof=freedom,
    )


def _slopes(factors: NDArray[np.int64], variance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Local slope of log variance against log averaging time, smoothed over three points."""
    if len(factors) < 2 or not (variance > 0).all():
        return np.full(len(factors), -1.0)
    slope = np.gradient(np.log(variance), np.log(factors))
    padded = np.concatenate([slope[:1], slope, slope[-1:]])
    smooth = (padded[:-2] + padded[1:-1] + padded[2:]) / 3
    # Quantisation noise dominates only at short times: a steep slope after a flatter one is chance, and its many degrees of
    # freedom would be wrong.
    return np.where(np.maximum.accumulate(smooth) < _QUANTISED, smooth, np.maximum(smooth, _QUANTISED))


def degrees_of_freedom(n: int, factor: int, slope: float) -> float:
    """Equivalent degrees of freedom of an overlapping estimate (NIST SP 1065, section 5.4.1).

    **Arguments:**

    - `n`: samples. `factor`: samples in an average. `slope`: of log variance: -2 quantisation, -1 white, 0 flicker,
      +1 random walk.
    """
    points, m = n + 1, factor
    if slope < _QUANTISED:
        value = (points + 1) * (points - 2 * m) / (2.0 * (points - m))
    elif slope < -0.5:
        value = (3 * (points - 1) / (2.0 * m) - 2 * (points - 2) / points) * 4 * m**2 / (4 * m**2 + 5)
    elif slope < 0.5:
        value = 2 * (points - 2) ** 2 / (2.3 * points - 4.9) if m == 1 else 5.0 * points**2 / (4 * m * (points + 3 * m))
    else:
        value = (points - 2) / m * ((points - 1) ** 2 - 3 * m * (points - 1) + 4 * m**2) / (points - 3) ** 2
    return max(float(value), 1.0)
