"""Still intervals of a recording, by its own noise.

A sliding window of a second is still when, on each axis, its variance, and the step between the means of its halves, are
what the recording shows while it lies still. That yardstick is found from the quietest windows on: the windows taken so far
give a median variance and, from its spread over windows, the degrees of freedom nu that it really has (white noise: samples
less one; a hand, a filter, a coarse step: fewer); all windows below the chi-squared quantile of nu, and with a step below
Student's t of nu, are taken next, until nothing changes. So `false_alarm` is the probability that a still window is refused
on one axis. Angular rates, where there are any, are judged by those of the windows that the accelerations call still:
variance, and mean against their common bias, with an allowance for a hand's tremor. Whatever unit the numbers are in makes no difference.
"""

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

from tumblecal.capture.still_blocks import Blocks


# A window is calm where its sd is below this share of gravity; calm seconds tell what still ones are like.
_CALM = 0.03
# Fewest degrees of freedom that the spread of the variances may give.
_FEWEST_DOF = 1.0
# A hand is steadier at one time than at another: so many times the limit in sd is allowed, each run trimmed by its own.
_ALLOWANCE = 1.5
# Angular rates tremble in a hand long before the mean force moves: so many times their own limit is allowed.
_RATE_ALLOWANCE = 4.0
# A knock of so many blocks with the same mean before and after it parts no interval.
_KNOCK_BLOCKS = 3
# A stretch that never gets quieter than so many times the still sd is a movement, not a refused interval.
_RESTLESS = 6.0
# Of an interval whose samples are the largest (or smallest) of the whole recording, so many: saturated.
_SATURATED = 0.5
# The size of gravity differs by so much between attitudes at most (bias, scale).
_ODD_SIZE = 0.3
_LEAST_FOR_LISTING = 0.3


@dataclass(frozen=True)
class Criterion:
    """When an interval counts as still.

    Parameters
    ----------
    false_alarm
        Probability that a still second is taken for a moving one, on one axis.
    least_s
        Shortest interval, s.
    guard_s
        Left out at both ends of an interval, s.
    """

    false_alarm: float = 1e-6
    least_s: float = 1.5
    guard_s: float = 0.2


@dataclass(frozen=True)
class Interval:
    """Rows `start` to `stop` of a recording, without those of `knocks` (pairs of rows).

    `reason` says why it is not used; empty where it is. `mean` (3): of the accelerations, in the recording's unit.
    """

    start: int
    stop: int
    start_s: float
    stop_s: float
    mean: NDArray[np.float64]
    knocks: tuple[tuple[int, int], ...] = ()
    reason: str = ""

    def as_dict(self) -> dict:
        """For a file."""
        told = asdict(self) | {"mean": self.mean.tolist(), "knocks": [list(pair) for pair in self.knocks]}
        return told | {"used": not self.reason}


@dataclass(frozen=True)
class Stillness:
    """What lies still in a recording.

    **Arguments:**

    - `intervals`: all, in order; those with a `reason` are not used.
    - `noise` (channels): sd of a sample within still windows; of the quietest where none is. `dof`: the variances' degrees of
      freedom, 0 where nothing is still.
    - `blocks`: what they were found in.
    """

    criterion: Criterion
    intervals: list[Interval]
    noise: NDArray[np.float64]
    dof: NDArray[np.float64]
    blocks: Blocks

    @property
    def used(self) -> list[Interval]:
        """Those that are used."""
        return [interval for interval in self.intervals if not interval.reason]


@dataclass(frozen=True)
class _Windows:
    """Windows of `length` blocks, one begun at each block: `excess` by channel is 1 at the limit, squared sizes."""

    length: int
    excess: NDArray[np.float64]
    noise: NDArray[np.float64]
    dof: NDArray[np.float64]
    step_limit: NDArray[np.float64]
    log_variance: NDArray[np.float64]
    step: NDArray[np.float64]

    @property
    def still(self) -> NDArray[np.bool_]:
        return (self.excess <= 1).all(1)


def still_intervals(blocks: Blocks, criterion: Criterion = Criterion()) -> Stillness:
    """The still intervals of a recording.

    **Arguments:**

    - `blocks`: of the recording, accelerations first.
    """
    length = max(4, round(min(1.0, criterion.least_s) * blocks.rate_hz / blocks.size))
    if len(blocks) < 2 * length:
        return Stillness(criterion, [], np.zeros(0), np.zeros(0), blocks)
    windows = _windows(blocks, criterion, length)
    runs = _joined(_runs(blocks, windows, criterion.false_alarm), blocks, windows)
    intervals = [_interval(run, blocks, criterion) for run in runs]
    intervals = [one for one in intervals if one.stop_s - one.start_s > _LEAST_FOR_LISTING]
    intervals = _of_odd_size(intervals) + _restless(intervals, blocks, windows, criterion)
    return Stillness(criterion, sorted(intervals, key=lambda one: one.start), windows.noise, windows.dof, blocks)


def _sliding(values: NDArray, length: int) -> NDArray:
    """Sums over `length` rows that follow one another."""
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    return total[length:] - total[:-length]


def _windows(blocks: Blocks, criterion: Criterion, length: int) -> _Windows:
    centred = blocks.mean - np.median(blocks.mean, axis=0)
    mean = _sliding(centred, length) / length
    between = blocks.size * np.maximum(_sliding(centred**2, length) - length * mean**2, 0)
    samples = blocks.size * length
    variance = (_sliding(blocks.squares, length) + between) / (samples - 1)
    log_variance = np.log(np.maximum(variance, np.maximum(blocks.quantum**2 / 12, 1e-300)))
    half = length // 2
    halves = _sliding(centred, half) / half
    step = halves[length - half :] - halves[: len(halves) - (length - half)]
    step = step[: len(mean)]
    whole = _sliding(blocks.broken[:, None].astype(float), length)[:, 0] - blocks.broken[: len(mean)] == 0
    force, rate = slice(0, 3), slice(3, None)
    size = np.median(np.linalg.norm(blocks.mean[:, :3], axis=1))
    calm = whole & (log_variance[:, force].max(1) < 2 * np.log(_CALM * size))
    weights = _by_run(calm, round(criterion.least_s * blocks.rate_hz / blocks.size) - length + 1, length // 2)
    if not weights.any():
        quietest = np.exp(log_variance[np.argmin(log_variance[:, force].max(1))] / 2)
        return _Windows(
            length, np.full(log_variance.shape, np.inf), quietest, 0 * quietest, quietest[:3], log_variance, step
        )
    excess, base, dof, limit = _excess(
        log_variance[:, force], step[:, force], weights, criterion.false_alarm, (_FEWEST_DOF, samples - 1)
    )
    excess = excess / _ALLOWANCE**2
    if blocks.mean.shape[1] > 3:
        bias = mean[:, rate] - _weighted_median(mean[:, rate], weights)
        by_rate = _excess(log_variance[:, rate], bias, weights, criterion.false_alarm, (_FEWEST_DOF, samples - 1))
        excess = np.hstack([excess, by_rate[0] / _RATE_ALLOWANCE**2])
        base, dof = np.concatenate([base, by_rate[1]]), np.concatenate([dof, by_rate[2]])
    excess = np.where(whole[:, None], excess, np.inf)
    return _Windows(length, excess, np.exp(base / 2), dof, limit, log_variance[:, force], step[:, force])


def _by_run(calm: NDArray[np.bool_], fewest: int, edge: int) -> NDArray[np.float64]:
    """Weights of the calm windows, alike for each run of at least `fewest`: a table says nothing of the hand after it. Where a
    run begins and ends, windows reach into the movement: `edge` are left out if enough remain."""
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
    log_variance: NDArray, offset: NDArray, weights: NDArray[np.float64], false_alarm: float, dofs: tuple[float, float]
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """How far windows are beyond the limits that those with a weight set: squared sizes, 1 at the limit; median log variance,
    degrees of freedom, and the limit of the offset."""
    own, taken = weights[weights > 0], weights > 0
    base = _weighted_median(log_variance[taken], own)
    spread = 1.4826 * np.maximum(
        _weighted_median(np.abs(log_variance[taken] - base), own),
        _weighted_median(log_variance[taken], own, 0.75) - base,
    )
    # The variance of the logarithm of chi-squared / nu is the trigamma function of nu / 2.
    dof = np.clip([2 * _inverse_trigamma(s**2) for s in spread], *dofs)
    variance_limit = np.log(stats.chi2.isf(false_alarm, dof) / stats.chi2.median(dof))
    size = 1.4826 * _weighted_median(np.abs(offset[taken]), own)
    # Not finer than white noise of that variance lets the difference of two half windows be seen.
    size = np.maximum(size, np.exp(base / 2) * 2 / np.sqrt(dofs[1] + 1))
    limit = size * stats.t.isf(false_alarm / 2, dof)
    return np.maximum(np.exp(log_variance - base - variance_limit), (offset / limit) ** 2), base, dof, limit


def _inverse_trigamma(value: float) -> float:
    """Newton's method on 1 / trigamma, which is nearly straight (Smyth 2004)."""
    value = max(value, 1e-8)
    x = 0.5 + 1 / value
    for _ in range(20):
        own = special.polygamma(1, x)
        x += own * (1 - own / value) / special.polygamma(2, x)
    return float(x)


def _runs(blocks: Blocks, windows: _Windows, false_alarm: float) -> list[list[tuple[int, int]]]:
    """Blocks that lie in a still window, as runs (start, stop); a gap parts them."""
    still = np.zeros(len(blocks), bool)
    for shift in range(windows.length):
        still[shift : shift + len(windows.excess)] |= windows.still
    begins = still & ~np.concatenate([[False], still[:-1] & ~blocks.broken[1:]])
    ends = still & ~np.concatenate([still[1:] & ~blocks.broken[1:], [False]])
    runs = zip(np.flatnonzero(begins), np.flatnonzero(ends) + 1, strict=True)
    return [
        [_trimmed(int(start), int(stop), windows, false_alarm, blocks.size * windows.length)] for start, stop in runs
    ]


def _trimmed(start: int, stop: int, windows: _Windows, false_alarm: float, samples: int) -> tuple[int, int]:
    """A run without the windows at its ends that are beyond its own limits: where others tremble more, a quiet run would else
    reach into the movement."""
    own = slice(start, max(start, stop - windows.length) + 1)
    log_variance, step = windows.log_variance[own], windows.step[own]
    edge = min(windows.length // 2, (len(step) - 1) // 2)
    weights = np.zeros(len(step))
    weights[edge : len(step) - edge] = 1.0
    excess = _excess(log_variance, step, weights, false_alarm, (_FEWEST_DOF, samples - 1))[0]
    calm = np.flatnonzero((excess <= 1).all(1))
    return start + int(calm[0]), start + int(calm[-1]) + windows.length


def _joined(runs: list[list[tuple[int, int]]], blocks: Blocks, windows: _Windows) -> list[list[tuple[int, int]]]:
    """Runs that only a knock parts, as one."""
    joined: list[list[tuple[int, int]]] = []
    half = windows.length // 2
    for run in runs:
        (start, stop), before = run[0], joined[-1][-1] if joined else None
        if before and start - before[1] <= _KNOCK_BLOCKS and not blocks.broken[before[1] : start + 1].any():
            earlier, later = slice(max(before[0], before[1] - half), before[1]), slice(start, min(start + half, stop))
            moved = blocks.mean[later, :3].mean(0) - blocks.mean[earlier, :3].mean(0)
            if (np.abs(moved) < windows.step_limit).all():
                joined[-1].append((start, stop))
                continue
        joined.append([(start, stop)])
    return joined


def _interval(run: list[tuple[int, int]], blocks: Blocks, criterion: Criterion) -> Interval:
    guard = round(criterion.guard_s * blocks.rate_hz)
    first, last = run[0][0], run[-1][1]
    start, stop = first * blocks.size + guard, last * blocks.size - guard
    length_s = (stop - start) / blocks.rate_hz
    start_s = float(blocks.start_s[first]) + criterion.guard_s
    rows = np.concatenate([np.arange(a, b) for a, b in run])
    mean = blocks.mean[rows, :3].mean(0)
    knocks = tuple((a[1] * blocks.size, b[0] * blocks.size) for a, b in zip(run, run[1:], strict=False))
    reason = (
        f"short: {max(length_s, 0):.1f} s, {criterion.least_s:g} s are needed" if length_s < criterion.least_s else ""
    )
    reason = reason or _saturation(rows, blocks, mean)
    return Interval(start, stop, start_s, start_s + max(length_s, 0.0), mean, knocks, reason)


def _saturation(rows: NDArray[np.int64], blocks: Blocks, mean: NDArray[np.float64]) -> str:
    """Samples that stay at the largest or smallest number of the recording, without noise."""
    still = blocks.squares[rows, :3].sum(0) <= 1e-12 * np.maximum(mean**2, 1e-300) * len(rows)
    at_limit = (np.abs(blocks.largest - mean) <= blocks.quantum[:3] / 2) | (
        np.abs(blocks.smallest - mean) <= blocks.quantum[:3] / 2
    )
    axes = [axis for axis, own in zip("xyz", still & at_limit, strict=True) if own]
    return f"saturated: axis {', '.join(axes)} stays at the end of its range" if axes else ""


def _of_odd_size(intervals: list[Interval]) -> list[Interval]:
    """Intervals in which the readings' size is not that of gravity are not still, whatever their noise."""
    sizes = np.array([np.linalg.norm(one.mean) for one in intervals if not one.reason])
    if not len(sizes):
        return intervals
    usual = float(np.median(sizes))
    told = []
    for one in intervals:
        ratio = float(np.linalg.norm(one.mean)) / usual
        odd = not one.reason and abs(ratio - 1) > _ODD_SIZE
        told.append(_with_reason(one, f"size: {ratio:.2f} times that of the others") if odd else one)
    return told


def _with_reason(interval: Interval, reason: str) -> Interval:
    from dataclasses import replace

    return replace(interval, reason=reason)


def _restless(intervals: list[Interval], blocks: Blocks, windows: _Windows, criterion: Criterion) -> list[Interval]:
    """Stretches between the intervals that nearly are still, with what speaks against them."""
    edges = [0, *(edge // blocks.size for one in intervals for edge in (one.start, one.stop)), len(blocks)]
    told = []
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        own = windows.excess[start : max(start, stop - windows.length)]
        if len(own) * blocks.size / blocks.rate_hz < criterion.least_s or not np.isfinite(own).any():
            continue
        quietest = own[int(np.argmin(own.max(1)))]
        times = float(np.sqrt(quietest.max()))
        if 1 < times < _RESTLESS:
            channel = ["axis x", "axis y", "axis z", "the rate of x", "the rate of y", "the rate of z"][
                int(np.argmax(quietest))
            ]
            span = float(blocks.start_s[start]), float(blocks.start_s[min(stop, len(blocks) - 1)])
            mean = blocks.mean[start:stop, :3].mean(0)
            reason = f"restless: {channel} at {times:.2f} times the limit in its quietest second"
            told.append(Interval(start * blocks.size, stop * blocks.size, *span, mean, (), reason))
    return told
