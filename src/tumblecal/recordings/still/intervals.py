"""Checks of intervals against each other: stuck or saturated axes, sizes different from gravity.

No check assumes a sensor without bias. Sizes are relative to the rough ellipsoid of all intervals, and are not checked if there
are too few intervals to determine it.
"""

from dataclasses import dataclass, replace

import numpy as np

from tumblecal.capture.decoding.samples import Floats, Integers
from tumblecal.ground.axes import AXES
from tumblecal.recordings.still.blocks import SignalBlocks
from tumblecal.recordings.still.rough_sensor import sizes_in_g


@dataclass(frozen=True)
class Interval:
    """Rows `start` to `stop` of a recording, without those of `knocks` (pairs of rows).

    `reason`: why it is not used; empty if it is. `mean` (3): mean accelerations, in the recording's unit.
    """

    start: int
    stop: int
    start_s: float
    stop_s: float
    mean: Floats
    knocks: tuple[tuple[int, int], ...] = ()
    reason: str = ""

    @property
    def used(self) -> bool:
        """Whether nothing speaks against it."""
        return not self.reason


# The size of readings at rest, after the rough bias, is gravity within this share.
_ODD_SIZE = 0.3
# More than this share of the samples at one number is a fault, if their noise is resolved by the steps of the numbers.
_SHARE_AT_END = 0.5


def judged(intervals: list[Interval], blocks: SignalBlocks, noise: Floats) -> tuple[list[Interval], bool]:
    """Intervals with the reasons why some are not used, and whether the attitudes sufficed to check sizes.

    **Arguments:**

    - `noise` (channels): of a sample at rest.
    """
    found = [one if one.reason else replace(one, reason=_at_one_number(one, blocks, noise)) for one in intervals]
    means = np.array([one.mean for one in found]).reshape(-1, 3)
    sizes = sizes_in_g(means, np.array([one.used for one in found], bool))
    if sizes is None:
        return found, False
    odd = [f"size: {size:.2f} times that of the others" if abs(size - 1) > _ODD_SIZE else "" for size in sizes]
    return [replace(one, reason=one.reason or words) for one, words in zip(found, odd, strict=True)], True


def blocks_of_interval(interval: Interval, blocks: SignalBlocks) -> Integers:
    """The blocks in an interval, without its knocks."""
    rows = blocks.row
    inside = (rows >= interval.start) & (rows + blocks.size <= interval.stop)
    for start, stop in interval.knocks:
        inside &= (rows + blocks.size <= start) | (rows >= stop)
    return np.flatnonzero(inside)


def _at_one_number(interval: Interval, blocks: SignalBlocks, noise: Floats) -> str:
    """Check for axes where most samples are one number, the largest or smallest in the interval, although their noise exceeds
    the steps of the numbers. At the end of the range they are saturated, otherwise stuck; coarse steps alone are neither."""
    rows = blocks_of_interval(interval, blocks)
    if not len(rows):
        return ""
    resolved = np.tile((noise[:3] > blocks.quantum[:3]) & (blocks.quantum[:3] > 0), 2)
    end = blocks.ends[rows].max(0)
    count = np.where(blocks.ends[rows] == end, blocks.at_ends[rows], 0).sum(0)
    found = resolved & (count > _SHARE_AT_END * len(rows) * blocks.size)
    saturated = found & (end == blocks.ends.max(0))
    for name, at, words in (("saturated", saturated, "the end of its range"), ("stuck", found, "one reading")):
        if at.any():
            return f"{name}: axis {AXES[int(at.argmax()) % 3]} stays at {words}"
    return ""
