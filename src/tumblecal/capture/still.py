"""The still intervals of a recording: runs of still windows, joined over knocks, and why others are refused."""

from dataclasses import asdict, dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.recordings.options import Criterion
from tumblecal.capture.still_blocks import Blocks
from tumblecal.capture.still_windows import Windows, trimmed, windows_of


# A knock of so many blocks with the same mean before and after it parts no interval.
_KNOCK_BLOCKS = 3
# A stretch that never gets quieter than so many times the still sd is a movement, not a refused interval.
_RESTLESS = 3.0
# The size of gravity differs by so much between attitudes at most (bias, scale).
_ODD_SIZE = 0.3
_LEAST_FOR_LISTING = 0.3
_ONE_ATTITUDE_DEG = 10.0


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

    def as_dict(self) -> dict:
        """For a file."""
        noise = {"noise": self.noise.tolist(), "dof": self.dof.tolist()}
        intervals = [interval.as_dict() for interval in self.intervals]
        return {"still": asdict(self.criterion) | noise, "intervals": intervals}

    @property
    def one_attitude(self) -> bool:
        """Whether all of them show gravity from about the same side."""
        means = np.array([interval.mean for interval in self.used])
        unit = means / np.linalg.norm(means, axis=1, keepdims=True)
        return bool((unit @ unit[0] > np.cos(np.radians(_ONE_ATTITUDE_DEG))).all())


def still_intervals(blocks: Blocks, criterion: Criterion = Criterion()) -> Stillness:
    """The still intervals of a recording.

    **Arguments:**

    - `blocks`: of the recording, accelerations first.
    """
    length = max(4, round(min(1.0, criterion.least_s) * blocks.rate_hz / blocks.size))
    if len(blocks) < 2 * length:
        return Stillness(criterion, [], np.zeros(0), np.zeros(0), blocks)
    windows = windows_of(blocks, criterion, length)
    runs = _joined(_runs(blocks, windows, criterion.false_alarm), blocks, windows)
    intervals = [_interval(run, blocks, criterion) for run in runs]
    intervals = [interval for interval in intervals if interval.stop_s - interval.start_s > _LEAST_FOR_LISTING]
    intervals = _of_odd_size(intervals) + _restless(intervals, blocks, windows, criterion)
    return Stillness(
        criterion, sorted(intervals, key=lambda interval: interval.start), windows.noise, windows.dof, blocks
    )


def _runs(blocks: Blocks, windows: Windows, false_alarm: float) -> list[list[tuple[int, int]]]:
    """Blocks that lie in a still window, as runs (start, stop); a gap parts them."""
    still = np.zeros(len(blocks), bool)
    for shift in range(windows.length):
        still[shift : shift + len(windows.excess)] |= windows.still
    begins = still & ~np.concatenate([[False], still[:-1] & ~blocks.broken[1:]])
    ends = still & ~np.concatenate([still[1:] & ~blocks.broken[1:], [False]])
    runs = zip(np.flatnonzero(begins), np.flatnonzero(ends) + 1, strict=True)
    samples = blocks.size * windows.length
    return [[trimmed((int(start), int(stop)), windows, false_alarm, samples)] for start, stop in runs]


def _joined(runs: list[list[tuple[int, int]]], blocks: Blocks, windows: Windows) -> list[list[tuple[int, int]]]:
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
    knocks = tuple((a[1] * blocks.size, b[0] * blocks.size) for a, b in pairwise(run))
    reason = _saturation(rows, blocks, mean)
    if length_s < criterion.least_s:
        reason = f"short: {max(length_s, 0):.1f} s, {criterion.least_s:g} s are needed"
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
    sizes = np.array([np.linalg.norm(interval.mean) for interval in intervals if not interval.reason])
    if not len(sizes):
        return intervals
    usual = float(np.median(sizes))
    told = []
    for interval in intervals:
        ratio = float(np.linalg.norm(interval.mean)) / usual
        odd = not interval.reason and abs(ratio - 1) > _ODD_SIZE
        told.append(replace(interval, reason=f"size: {ratio:.2f} times that of the others") if odd else interval)
    return told


def _restless(intervals: list[Interval], blocks: Blocks, windows: Windows, criterion: Criterion) -> list[Interval]:
    """Stretches between the intervals that nearly are still, with what speaks against them."""
    edges = [
        0,
        *(edge // blocks.size for interval in intervals for edge in (interval.start, interval.stop)),
        len(blocks),
    ]
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
