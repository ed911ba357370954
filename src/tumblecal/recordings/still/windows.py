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

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from tumblecal.recordings.options import Criterion
from tumblecal.recordings.still.blocks import SignalBlocks


# A window is calm if its standard deviation is below this share of gravity, or a step of the numbers.
_CALM = 0.03
# A smaller share of gravity is rounding, not noise.
_FINEST = 1e-9
# Lower limit of the degrees of freedom from the spread of the variances.
_FEWEST_DOF = 1.0
# Allowed multiple of the limits in standard deviation, for accelerations and for angular rates.
_ALLOWANCE, _RATE_ALLOWANCE = 1.5, 4.0


@dataclass(frozen=True)
class Windows:
    """Windows of `length` blocks, one from each block on.

    **Arguments:**

    - `excess` (windows, channels): squared sizes, 1 at the limit. `noise`, `dof` (channels): standard deviation and degrees of
      freedom of still windows. For the accelerations: `step_limit`, and `quantum`, the smallest step of the numbers (3);
      `log_variance`, `step` (windows, 3).
    """

    length: int
    excess: NDArray[np.float64]
    noise: NDArray[np.float64]
    dof: NDArray[np.float64]
    step_limit: NDArray[np.float64]
    quantum: NDArray[np.float64]
    log_variance: NDArray[np.float64]
    step: NDArray[np.float64]

    @property
    def still(self) -> NDArray[np.bool_]:
        """Mask of still windows."""
        return np.asarray((self.excess <= 1).all(1))

    @property
    def jump(self) -> NDArray[np.float64]:
        """The steps between the halves of windows, relative to the limit (windows)."""
        return (np.abs(self.step) / (_ALLOWANCE * self.step_limit)).max(1)


def _sliding(values: NDArray, length: int) -> NDArray:
    """Sums over `length` consecutive rows."""
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    return total[length:] - total[:-length]


def windows_of(blocks: SignalBlocks, criterion: Criterion, length: int) -> Windows:
    """The windows of `length` blocks, with the limits for rest."""
    centred = blocks.mean - np.median(blocks.mean, axis=0)
    mean = _sliding(centred, length) / length
    between = blocks.size * np.maximum(_sliding(centred**2, length) - length * mean**2, 0)
    samples = blocks.size * length
    variance = (_sliding(blocks.squares, length) + between) / (samples - 1)
    size = np.median(np.linalg.norm(blocks.mean[:, :3], axis=1))
    finest = np.full(len(blocks.quantum), _FINEST * size)
    finest[3:] = 0.0
    log_variance = np.log(np.maximum(variance, np.maximum(blocks.quantum**2 / 12, np.maximum(finest**2, 1e-300))))
    half = length // 2
    halves = _sliding(centred, half) / half
    step = halves[length - half :] - halves[: len(halves) - (length - half)]
    step = step[: len(mean)]
    whole = _sliding(blocks.broken[:, None].astype(float), length)[:, 0] - blocks.broken[: len(mean)] == 0
    force, rate = slice(0, 3), slice(3, None)
    calm = whole & (log_variance[:, force].max(1) < 2 * np.log(max(_CALM * size, blocks.quantum[0])))
    weights = _by_run(calm, int(criterion.least_s * blocks.rate_hz / blocks.size) - length + 1, length // 2)
    if not weights.any():
        quietest = np.exp(log_variance[np.argmin(log_variance[:, force].max(1))] / 2)
        none = np.full(log_variance.shape, np.inf)
        return Windows(length, none, quietest, 0 * quietest, quietest[:3], quietest[:3], log_variance, step)
    excess, base, dof, limit = _excess(
        log_variance[:, force],
        step[:, force],
        weights,
        criterion.false_alarm,
        (_FEWEST_DOF, samples - 1),
        blocks.quantum[force],
    )
    excess = excess / _ALLOWANCE**2
    if blocks.mean.shape[1] > 3:
        bias = mean[:, rate] - _weighted_median(mean[:, rate], weights)
        dofs = (_FEWEST_DOF, samples - 1)
        by_rate = _excess(log_variance[:, rate], bias, weights, criterion.false_alarm, dofs, blocks.quantum[rate])
        excess = np.hstack([excess, by_rate[0] / _RATE_ALLOWANCE**2])
        base, dof = np.concatenate([base, by_rate[1]]), np.concatenate([dof, by_rate[2]])
    excess = np.where(whole[:, None], excess, np.inf)
    return Windows(
        length, excess, np.exp(base / 2), dof, limit, blocks.quantum[force], log_variance[:, force], step[:, force]
    )


def _by_run(calm: NDArray[np.bool_], fewest: int, edge: int) -> NDArray[np.float64]:
    """Weights of the calm windows, with equal sums for all runs of at least `fewest`: noise on a table does not show that of a
    hand. At its ends, windows of a run include movement: `edge` windows are excluded if enough remain."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], calm, [False]]).astype(int)))
    weights = np.zeros(len(calm))
    for start, stop in edges.reshape(-1, 2):
        if stop - start >= fewest:
            cut = min(edge, (stop - start - 1) // 2)
            weights[start + cut : stop - cut] = 1 / (stop - start - 2 * cut)
    return weights


def _weighted_median(values: NDArray, weights: NDArray[np.float64], share: float = 0.5) -> NDArray[np.float64]:
    """Medians (or another quantile) of the columns of values (n, channels)."""
    order = np.argsort(values, axis=0)
    total = np.cumsum(weights[order], axis=0)
    middle = (total >= share * total[-1]).argmax(0)
    columns = np.arange(values.shape[1])
    return values[order[middle, columns], columns]


def _excess(
    log_variance: NDArray,
    offset: NDArray,
    weights: NDArray[np.float64],
    false_alarm: float,
    dofs: tuple[float, float],
    quantum: NDArray[np.float64],
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Excess of windows over the limits from the weighted windows: squared sizes, 1 at the limit; median log variance, degrees
    of freedom, and the limit of the offset."""
    positive, calm = weights[weights > 0], weights > 0
    base = _weighted_median(log_variance[calm], positive)
    spread = 1.4826 * np.maximum(
        _weighted_median(np.abs(log_variance[calm] - base), positive),
        _weighted_median(log_variance[calm], positive, 0.75) - base,
    )
    # The variance of the logarithm of chi-squared / nu is the trigamma function of nu / 2.
    dof = np.clip(2 * _inverse_trigamma(spread**2), *dofs)
    variance_limit = np.log(special.chdtri(dof, false_alarm) / special.chdtri(dof, 0.5))
    # Readings that alternate between two neighbouring numbers are at rest as far as coarse steps show, whatever their shares.
    variance_limit = np.maximum(variance_limit, np.log(np.maximum(quantum, 1e-150) / 2) * 2 - base)
    size = 1.4826 * _weighted_median(np.abs(offset[calm]), positive)
    # The resolution of the difference of two half windows is limited by white noise of that variance.
    size = np.maximum(size, np.exp(base / 2) * 2 / np.sqrt(dofs[1] + 1))
    limit = np.maximum(size * -special.stdtrit(dof, false_alarm / 2), quantum)
    return np.maximum(np.exp(log_variance - base - variance_limit), (offset / limit) ** 2), base, dof, limit


def _inverse_trigamma(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Newton's method on 1 / trigamma, which is nearly linear (Smyth 2004)."""
    values = np.maximum(values, 1e-8)
    x = 0.5 + 1 / values
    for _ in range(10):
        trigamma = special.polygamma(1, x)
        x = x + trigamma * (1 - trigamma / values) / special.polygamma(2, x)
    return x


def trimmed(run: tuple[int, int], windows: Windows, false_alarm: float, samples: int) -> tuple[int, int]:
    """A run without the windows at its ends that exceed its individual limits; otherwise a quiet run would extend into the
    movement if other runs tremble more."""
    start, stop = run
    rows = slice(start, max(start, stop - windows.length) + 1)
    log_variance, step = windows.log_variance[rows], windows.step[rows]
    edge = min(windows.length // 2, (len(step) - 1) // 2)
    weights = np.zeros(len(step))
    weights[edge : len(step) - edge] = 1.0
    excess = _excess(log_variance, step, weights, false_alarm, (_FEWEST_DOF, samples - 1), windows.quantum)[0]
    calm = np.flatnonzero((excess <= 1).all(1))
    return start + int(calm[0]), start + int(calm[-1]) + windows.length
