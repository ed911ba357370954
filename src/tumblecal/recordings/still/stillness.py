"""The intervals at rest of a recording: runs of still windows, joined over knocks, and reasons against other intervals."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tumblecal.ground.gravity import STANDARD, unit_in_g
from tumblecal.recordings.options import Criterion
from tumblecal.recordings.still.blocks import SignalBlocks
from tumblecal.recordings.still.intervals import Interval, judged
from tumblecal.recordings.still.windows import Windows, trimmed, windows_of


# A knock of up to this many blocks, with the same mean before and after it, does not split an interval.
_KNOCK_BLOCKS = 3
# A stretch that is never quieter than this many times the standard deviation at rest is a movement, not a rejected interval.
_RESTLESS = 3.0
# A jump is at least this many times the median step in the rest of its run, since the tremble of hands differs.
_STEPS_OF_RUN = 8.0
# Means within this many windows on both sides of a jump differ by this share of it; after a swing they do not.
_NEAR_JUMP, _LASTING = 3, 0.5
_LEAST_FOR_LISTING = 0.3
_ONE_ATTITUDE_DEG = 10.0


@dataclass(frozen=True)
class Stillness:
    """The intervals at rest of a recording.

    **Arguments:**

    - `intervals`: all, in order; intervals with a `reason` are not used.
    - `noise` (channels): standard deviation of a sample within still windows, or in the quietest window if none is still.
      `dof`: degrees of freedom of the variances, 0 if nothing is still.
    - `blocks`: the blocks of the recording. `joins`: number of places where intervals follow each other without movement.
    - `size_judged`: whether the attitudes sufficed to check their sizes.
    """

    criterion: Criterion
    intervals: list[Interval]
    noise: NDArray[np.float64]
    dof: NDArray[np.float64]
    blocks: SignalBlocks
    joins: int = 0
    size_judged: bool = False

    @property
    def used(self) -> list[Interval]:
        """The used intervals."""
        return [interval for interval in self.intervals if not interval.reason]

    def as_dict(self) -> dict[str, Any]:
        """The intervals as keys and values of a file."""
        noise = {"noise": self.noise.tolist(), "dof": self.dof.tolist(), "coarse_steps": self.coarse}
        judged = {"joins": self.joins, "size_judged": self.size_judged}
        intervals = [interval.as_dict() for interval in self.intervals]
        return {"still": asdict(self.criterion) | noise | judged, "intervals": intervals}

    def rejecting(self, reasons: Mapping[int, str]) -> "Stillness":
        """This result with reasons against some of the used intervals, by their first row."""
        intervals = [replace(one, reason=one.reason or reasons.get(one.start, "")) for one in self.intervals]
        return replace(self, intervals=intervals)

    @property
    def one_attitude(self) -> bool:
        """Whether all of them have about the same attitude, by the differences of their means, which no bias affects."""
        means = np.array([interval.mean for interval in self.used])
        far = 2 * np.sin(np.radians(_ONE_ATTITUDE_DEG) / 2) / unit_in_g(self.blocks.unit, STANDARD)
        return bool((np.linalg.norm(means - means[0], axis=1) < far).all())

    @property
    def coarse(self) -> dict[str, float]:
        """The steps of the readings, in their unit, for the axes with steps wider than twice the noise."""
        steps = zip("xyz", self.blocks.quantum, self.noise, strict=False)
        return {axis: float(step) for axis, step, noise in steps if step > 2 * noise}


def still_intervals(blocks: SignalBlocks, criterion: Criterion = Criterion()) -> Stillness:
    """Find the intervals at rest of a recording.

    **Arguments:**

    - `blocks`: blocks of the recording, accelerations first.
    """
    length = max(4, 2 * round(min(1.0, criterion.least_s) * blocks.rate_hz / blocks.size / 2))
    if len(blocks) < 2 * length:
        return Stillness(criterion, [], np.zeros(0), np.zeros(0), blocks)
    windows = windows_of(blocks, criterion, length)
    runs = _joined(_runs(blocks, windows, criterion.false_alarm), blocks, windows)
    moving = len(blocks) - sum(stop - start for run in runs for start, stop in run) > length
    intervals = [_interval(run, blocks, criterion, moving=moving) for run in runs]
    intervals = [interval for interval in intervals if interval.stop_s - interval.start_s > _LEAST_FOR_LISTING]
    intervals, size_judged = judged(intervals, blocks, windows)
    joins = sum(blocks.broken[run[0][0]] or run[0][0] == before[-1][1] for before, run in pairwise(runs))
    intervals += _restless(intervals, blocks, windows, criterion)
    intervals = sorted(intervals, key=lambda interval: interval.start)
    return Stillness(criterion, intervals, windows.noise, windows.dof, blocks, int(joins), size_judged)


def _runs(blocks: SignalBlocks, windows: Windows, false_alarm: float) -> list[list[tuple[int, int]]]:
    """Runs (start, stop) of blocks in which each two neighbours are in one still window; split where the mean jumps."""
    still, linked = (_covered(windows.still, windows.length, len(blocks), inner) for inner in (0, 1))
    begins = still & ~(linked & np.concatenate([[False], still[:-1]]))
    starts = np.flatnonzero(begins)
    ends = np.flatnonzero(still & np.concatenate([begins[1:] | ~still[1:], [True]])) + 1
    samples = blocks.size * windows.length
    runs = (
        trimmed((int(start), int(stop)), windows, false_alarm, samples)
        for start, stop in zip(starts, ends, strict=True)
    )
    return [[part] for run in runs for part in _parted(run, blocks, windows)]


def _covered(still: NDArray[np.bool_], length: int, count: int, inner: int) -> NDArray[np.bool_]:
    """Mask of blocks in a still window, except its first `inner` blocks."""
    edges = np.zeros(count + 1, int)
    first = np.flatnonzero(still)
    np.add.at(edges, first + inner, 1)
    np.add.at(edges, first + length, -1)
    return np.cumsum(edges)[:count] > 0


def _parted(run: tuple[int, int], blocks: SignalBlocks, windows: Windows) -> list[tuple[int, int]]:
    """Split a run where the step between the halves of a window exceeds the limit and lasts: slow drift has no such step, and
    that of a swing does not last."""
    start, stop = run
    half = windows.length // 2
    jump = windows.jump[start : max(start, stop - windows.length + 1)]
    for window in np.flatnonzero((jump > 1) & (jump == ndimage.maximum_filter1d(jump, windows.length, mode="nearest"))):
        elsewhere = np.delete(jump, slice(max(0, window - windows.length), window + windows.length))
        if len(elsewhere) >= windows.length and jump[window] < _STEPS_OF_RUN * np.median(elsewhere):
            continue
        at, axis = start + int(window) + half, int(np.argmax(np.abs(windows.step[start + window] / windows.step_limit)))
        width = _NEAR_JUMP * windows.length
        before, after = (blocks.mean[a:b, axis] for a, b in ((max(start, at - width), at), (at, min(stop, at + width))))
        if np.abs(after.mean() - before.mean()) > _LASTING * np.abs(windows.step[start + window, axis]):
            return [(start, at), *_parted((at, stop), blocks, windows)]
    return [run]


def _joined(runs: list[list[tuple[int, int]]], blocks: SignalBlocks, windows: Windows) -> list[list[tuple[int, int]]]:
    """Join runs that only a knock separates."""
    joined: list[list[tuple[int, int]]] = []
    width = _NEAR_JUMP * windows.length
    for run in runs:
        (start, stop), before = run[0], joined[-1][-1] if joined else None
        if before and start - before[1] <= _KNOCK_BLOCKS and not blocks.broken[before[1] : start + 1].any():
            earlier, later = (
                slice(max(before[0], before[1] - width), before[1]),
                slice(start, min(start + width, stop)),
            )
            moved = blocks.mean[later, :3].mean(0) - blocks.mean[earlier, :3].mean(0)
            if (np.abs(moved) < windows.step_limit).all():
                joined[-1].append((start, stop))
                continue
        joined.append([(start, stop)])
    return joined


def _interval(run: list[tuple[int, int]], blocks: SignalBlocks, criterion: Criterion, *, moving: bool) -> Interval:
    """A run as an interval. A guard excludes movement: at a cut of the recording there is no guard, unless a longer one was
    stated; at the ends of the recording there is one if the recording has any movement."""
    stated = criterion.guard_s if criterion.guard_s > Criterion.guard_s else 0.0
    first, last = run[0][0], run[-1][1] - 1
    cut = blocks.broken[first] or (first == 0 and not moving)
    start = int(blocks.row[first]) + round((stated if cut else criterion.guard_s) * blocks.rate_hz)
    stop = blocks.stop_row(last)
    cut = stop in blocks.cuts and (stop < blocks.rows or not moving)
    stop -= round((stated if cut else criterion.guard_s) * blocks.rate_hz)
    length_s = (stop - start) / blocks.rate_hz
    start_s = float(blocks.start_s[first] + (start - blocks.row[first]) / blocks.rate_hz)
    mean = np.concatenate([blocks.mean[a:b, :3] for a, b in run]).mean(0)
    knocks = tuple((blocks.stop_row(a[1] - 1), int(blocks.row[b[0]])) for a, b in pairwise(run))
    short = length_s + 0.5 / blocks.rate_hz < criterion.least_s
    reason = f"short: {max(length_s, 0):.1f} s, {criterion.least_s:g} s are needed" if short else ""
    return Interval(start, stop, start_s, start_s + max(length_s, 0.0), mean, knocks, reason)


def _restless(
    intervals: list[Interval], blocks: SignalBlocks, windows: Windows, criterion: Criterion
) -> list[Interval]:
    """Stretches between the intervals that are nearly at rest, with the reasons against them."""
    edges = [
        0,
        *(int(np.searchsorted(blocks.row, edge)) for interval in intervals for edge in (interval.start, interval.stop)),
        len(blocks),
    ]
    rejected = []
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        excess = windows.excess[start : max(start, stop - windows.length)]
        if len(excess) * blocks.size / blocks.rate_hz < criterion.least_s or not np.isfinite(excess).any():
            continue
        quietest = excess[int(np.argmin(excess.max(1)))]
        times = float(np.sqrt(quietest.max()))
        if 1 < times < _RESTLESS:
            channel = ["axis x", "axis y", "axis z", "the rate of x", "the rate of y", "the rate of z"][
                int(np.argmax(quietest))
            ]
            span = float(blocks.start_s[start]), float(blocks.start_s[min(stop, len(blocks) - 1)])
            mean = blocks.mean[start:stop, :3].mean(0)
            reason = f"restless: {channel} at {times:.2f} times the limit in its quietest second"
            rows = int(blocks.row[start]), blocks.stop_row(stop - 1)
            rejected.append(Interval(*rows, *span, mean, (), reason))
    return rejected
