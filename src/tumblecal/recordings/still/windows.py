"""Criterion for a second at rest, by the noise of the recording.

A sliding window of a second has, on each axis, a variance, and a step between the means of its halves. Calm windows (standard
deviation below 3 % of gravity) show both at rest, and each run of them has one vote: the median variance and, from the spread
of its logarithm, its effective degrees of freedom nu (white noise: samples minus one; fewer for a hand, a filter, or coarse
quantisation). A window is still if its variance is below the chi-squared quantile of nu and its step is below Student's t of
nu, so `false_alarm` is the probability that a still window is rejected on one axis. Since the steadiness of a hand varies, 1.5
times these limits in standard deviation are allowed. Angular rates, if there are any, are checked in the same way, by their
variance and their mean against the common bias, with a factor of 4: they tremble long before the mean force moves. The unit
of the numbers has no influence.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from tumblecal.capture.decoding.samples import Floats
from tumblecal.recordings.options import Criterion
from tumblecal.recordings.still.blocks import SignalBlocks


# A window is calm if its standard deviation is below this share of gravity, or a step of the numbers.
_CALM = 0.03
# A smaller share of gravity is rounding, not noise.
_FINEST = 1e-9
# Lower limit of the degrees of freedom from the spread of the variances.
_FEWEST_DOF = 1.0
# Allowed multiples of the limits in standard deviation: 1.5 for accelerations, 4 for angular rates.
ALLOWANCES = np.repeat([1.5, 4.0], 3)


@dataclass(frozen=True)
class Limits:
    """The noise at rest by channel, and the limits for it: `base`, median logarithm of the variance; `dof`, its degrees of
    freedom; `variance`, largest logarithm of a variance above the base; `offset`, largest step of the mean."""

    base: Floats
    dof: Floats
    variance: Floats
    offset: Floats


@dataclass(frozen=True)
class Windows:
    """Windows of `length` blocks, `samples` samples, one from each block on.

    **Arguments:**

    - `log_variance`, `offset` (windows, channels): logarithm of the variance, infinite if a cut is inside; step between the
      means of the halves of accelerations, difference of the mean of a rate from its bias.
    - `quantum` (channels): smallest step of the numbers.
    - `limits`: for rest; None if no run of windows is calm.
    """

    length: int
    samples: int
    log_variance: Floats
    offset: Floats
    quantum: Floats
    false_alarm: float
    limits: Limits | None = None

    def limits_of(self, rows: slice, weights: Floats) -> Limits:
        """The limits from some of the windows, with weights (windows of `rows`)."""
        calm, positive = weights > 0, weights[weights > 0]
        log_variance, offset = self.log_variance[rows][calm], self.offset[rows][calm]
        base = _quantile(log_variance, positive)
        spread = 1.4826 * np.maximum(
            _quantile(np.abs(log_variance - base), positive), _quantile(log_variance, positive, 0.75) - base
        )
        # The variance of the logarithm of chi-squared / nu is the trigamma function of nu / 2.
        dof = np.clip(2 * _inverse_trigamma(spread**2), _FEWEST_DOF, self.samples - 1)
        variance = np.log(special.chdtri(dof, self.false_alarm) / special.chdtri(dof, 0.5))
        # Readings that alternate between two neighbouring numbers are at rest as far as coarse steps show.
        variance = np.maximum(variance, np.log(np.maximum(self.quantum, 1e-150) / 2) * 2 - base)
        # The resolution of the difference of two half windows is limited by white noise of that variance.
        resolution = np.exp(base / 2) * 2 / np.sqrt(self.samples)
        size = np.maximum(1.4826 * _quantile(np.abs(offset), positive), resolution)
        return Limits(base, dof, variance, np.maximum(size * -special.stdtrit(dof, self.false_alarm / 2), self.quantum))

    def excess(self, limits: Limits, rows: slice = slice(None)) -> Floats:
        """Excess of windows over limits (windows, channels): squared sizes, 1 at the limit."""
        by_variance = np.exp(self.log_variance[rows] - limits.base - limits.variance)
        return np.maximum(by_variance, (self.offset[rows] / limits.offset) ** 2)

    def trimmed(self, run: tuple[int, int]) -> tuple[int, int]:
        """A run of blocks without the windows at its ends whose accelerations exceed its individual limits; otherwise a quiet
        run would extend into the movement if other runs tremble more."""
        start, stop = run
        rows = slice(start, max(start, stop - self.length) + 1)
        weights = np.ones(rows.stop - start)
        edge = min(self.length // 2, (len(weights) - 1) // 2)
        weights[:edge] = weights[len(weights) - edge :] = 0.0
        excess = self.excess(self.limits_of(rows, weights), rows)[:, :3]
        calm = start + np.flatnonzero((excess <= 1).all(1))
        return (int(calm[0]), int(calm[-1]) + self.length) if len(calm) else run


def windows_of(blocks: SignalBlocks, criterion: Criterion, length: int) -> Windows:
    """The windows of `length` blocks (an even number), with the limits for rest."""
    centred, samples = blocks.mean - np.median(blocks.mean, axis=0), blocks.size * length
    mean = _sliding(centred, length) / length
    between = blocks.size * np.maximum(_sliding(centred**2, length) - length * mean**2, 0)
    variance = (_sliding(blocks.squares, length) + between) / (samples - 1)
    size = np.median(np.linalg.norm(blocks.mean[:, :3], axis=1))
    finest = np.where(np.arange(len(blocks.quantum)) < 3, (_FINEST * size) ** 2, 0.0)
    floor = np.maximum(np.maximum(blocks.quantum**2 / 12, finest), 1e-300)
    halves = _sliding(centred, length // 2) / (length // 2)
    offset = halves[length // 2 :] - halves[: -length // 2]
    log_variance = np.log(np.maximum(variance, floor))
    log_variance[_sliding(blocks.broken[1:].astype(int), length - 1) > 0] = np.inf
    windows = Windows(length, samples, log_variance, offset, blocks.quantum, criterion.false_alarm)
    calm = log_variance[:, :3].max(1) < 2 * np.log(max(_CALM * size, blocks.quantum[0]))
    weights = _by_run(calm, int(criterion.least_s * blocks.rate_hz / blocks.size) - length + 1, length // 2)
    if not weights.any():
        return windows
    offset[:, 3:] = mean[:, 3:] - _quantile(mean[weights > 0, 3:], weights[weights > 0])
    return replace(windows, limits=windows.limits_of(slice(None), weights))


def _sliding(values: NDArray, length: int) -> NDArray:
    """Sums over `length` consecutive rows."""
    total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    return total[length:] - total[:-length]


def _by_run(calm: NDArray[np.bool_], fewest: int, edge: int) -> Floats:
    """Weights of the calm windows, with equal sums for all runs of at least `fewest`: noise on a table does not show that of a
    hand. At its ends, windows of a run include movement: `edge` windows are excluded if enough remain."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], calm, [False]]).astype(int)))
    weights = np.zeros(len(calm))
    for start, stop in edges.reshape(-1, 2):
        if stop - start >= fewest:
            cut = min(edge, (stop - start - 1) // 2)
            weights[start + cut : stop - cut] = 1 / (stop - start - 2 * cut)
    return weights


def _quantile(values: Floats, weights: Floats, share: float = 0.5) -> Floats:
    """The weighted quantile of each column of values (n, channels)."""
    return np.quantile(values, share, axis=0, weights=weights, method="inverted_cdf")


def _inverse_trigamma(values: Floats) -> Floats:
    """Newton's method on 1 / trigamma, which is nearly linear (Smyth 2004)."""
    values = np.maximum(values, 1e-8)
    x = 0.5 + 1 / values
    for _ in range(10):
        trigamma = special.polygamma(1, x)
        x = x + trigamma * (1 - trigamma / values) / special.polygamma(2, x)
    return x
