"""The intervals at rest of a recording: runs of still windows, joined over knocks, and reasons against other intervals."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy import ndimage

from tumblecal.capture.decoding.samples import Floats
from tumblecal.ground.gravity import STANDARD, unit_in_g
from tumblecal.recordings.options import Criterion
from tumblecal.recordings.still.blocks import SignalBlocks
from tumblecal.recordings.still.intervals import ONE_ATTITUDE_G, Interval, judged
from tumblecal.recordings.still.windows import ALLOWANCES, windows_of


# A knock of up to this many blocks, with the same mean within this many windows on both sides, does not split an interval.
_KNOCK_BLOCKS, _NEAR_KNOCK = 3, 3
# A jump is at least this many times the median step in the rest of its run, since the tremble of hands differs.
_STEPS_OF_RUN = 8.0
_LEAST_FOR_LISTING = 0.3
# Parts (first block, block after the last) of an interval; the blocks between them are knocks.
_Parts = list[tuple[int, int]]


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
    noise: Floats
    dof: Floats
    blocks: SignalBlocks
    joins: int = 0
    size_judged: bool = False

    @property
    def used(self) -> list[Interval]:
        """The used intervals."""
        return [interval for interval in self.intervals if interval.used]

    def rejecting(self, reasons: Mapping[int, str]) -> "Stillness":
        """This result with reasons against some of the used intervals, by their first row."""
        intervals = [replace(one, reason=one.reason or reasons.get(one.start, "")) for one in self.intervals]
        return replace(self, intervals=intervals)

    @property
    def one_attitude(self) -> bool:
        """Whether all of them have about the same attitude, by the differences of their means, which no bias affects."""
        means = np.array([interval.mean for interval in self.used])
        far = ONE_ATTITUDE_G / unit_in_g(self.blocks.unit, STANDARD)
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
    if windows.limits is None:
        quietest = np.exp(windows.log_variance[np.argmin(windows.log_variance[:, :3].max(1))] / 2)
        return Stillness(criterion, [], quietest, 0 * quietest, blocks)
    noise = np.exp(windows.limits.base / 2)
    excess = windows.excess(windows.limits) / ALLOWANCES[: len(noise)] ** 2
    first = np.flatnonzero((excess <= 1).all(1))
    # Runs of blocks in which each two neighbours are in one still window.
    groups = np.split(first, np.flatnonzero(np.diff(first) >= length) + 1)
    whole = [(int(group[0]), int(group[-1]) + length) for group in groups if len(group)]
    limit = windows.limits.offset[:3]
    jump = (np.abs(windows.offset[:, :3]) / (ALLOWANCES[:3] * limit)).max(1)
    parts = [part for run in whole for part in _parted(windows.trimmed(run), jump, length)]
    runs = _joined(parts, blocks, limit, _NEAR_KNOCK * length)
    moving = len(blocks) - sum(stop - start for run in runs for start, stop in run) > length
    intervals = [_interval(run, blocks, criterion, moving=moving) for run in runs]
    intervals = [interval for interval in intervals if interval.stop_s - interval.start_s > _LEAST_FOR_LISTING]
    intervals, size_judged = judged(intervals, blocks, noise)
    joins = sum(blocks.broken[run[0][0]] or run[0][0] == before[-1][1] for before, run in pairwise(runs))
    return Stillness(criterion, intervals, noise, windows.limits.dof, blocks, int(joins), size_judged)


def _parted(run: tuple[int, int], jumps: Floats, length: int) -> _Parts:
    """Split a run where the step between the halves of a window exceeds the limit: slow drift has no such step.

    **Arguments:**

    - `jumps` (windows): the steps relative to the limit. `length`: of a window, in blocks.
    """
    start, stop = run
    jump = jumps[start : max(start, stop - length + 1)]
    for window in np.flatnonzero((jump > 1) & (jump == ndimage.maximum_filter1d(jump, length, mode="nearest"))):
        elsewhere = np.delete(jump, slice(max(0, window - length), window + length))
        if len(elsewhere) < length or jump[window] >= _STEPS_OF_RUN * np.median(elsewhere):
            at = start + int(window) + length // 2
            return [(start, at), *_parted((at, stop), jumps, length)]
    return [run]


def _joined(parts: _Parts, blocks: SignalBlocks, limit: Floats, width: int) -> list[_Parts]:
    """The parts of each interval: parts that only a knock separates, with means of `width` blocks that differ by less than the
    limit (3), are one."""
    joined = list[_Parts]()
    for start, stop in parts:
        begin, end = joined[-1][-1] if joined else (0, -len(blocks))
        if start - end <= _KNOCK_BLOCKS and not blocks.broken[end : start + 1].any():
            earlier = blocks.mean[max(begin, end - width) : end, :3].mean(0)
            later = blocks.mean[start : min(start + width, stop), :3].mean(0)
            if (np.abs(later - earlier) < limit).all():
                joined[-1].append((start, stop))
                continue
        joined.append([(start, stop)])
    return joined


def _interval(run: _Parts, blocks: SignalBlocks, criterion: Criterion, *, moving: bool) -> Interval:
    """A run as an interval. A guard excludes movement: at a cut of the recording there is no guard, unless a longer one was
    stated; at the ends of the recording there is one if the recording has any movement."""
    first, last = run[0][0], run[-1][1] - 1
    start, stop = int(blocks.row[first]), int(blocks.stop[last])
    at_cut = (
        blocks.broken[first] or (first == 0 and not moving),
        stop in blocks.cuts and (stop < blocks.rows or not moving),
    )
    stated = criterion.guard_s if criterion.guard_s > Criterion.guard_s else 0.0
    guards = [round((stated if cut else criterion.guard_s) * blocks.rate_hz) for cut in at_cut]
    length_s = (stop - start - sum(guards)) / blocks.rate_hz
    start_s = float(blocks.start_s[first] + guards[0] / blocks.rate_hz)
    mean = np.concatenate([blocks.mean[a:b, :3] for a, b in run]).mean(0)
    knocks = tuple((int(blocks.stop[a[1] - 1]), int(blocks.row[b[0]])) for a, b in pairwise(run))
    short = length_s + 0.5 / blocks.rate_hz < criterion.least_s
    reason = f"short: {max(length_s, 0):.1f} s, {criterion.least_s:g} s are needed" if short else ""
    return Interval(start + guards[0], stop - guards[1], start_s, start_s + max(length_s, 0.0), mean, knocks, reason)
