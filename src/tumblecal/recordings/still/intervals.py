"""Checks of intervals against each other: stuck or saturated axes, wandering means, sizes different from gravity.

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
# Wandering means of half seconds exceed those of other intervals by this factor, and this share of gravity.
_WANDER, _WANDER_SHARE, _FEWEST = 4.0, 0.03, 3


def judged(intervals: list[Interval], blocks: SignalBlocks, noise: Floats, half: int) -> tuple[list[Interval], bool]:
    """Intervals with the reasons why some are not used, and whether the attitudes sufficed to check sizes.

    **Arguments:**

    - `noise` (channels): of a sample at rest. `half`: number of blocks in half a second.
    """
    rows = [blocks_of_interval(interval, blocks) for interval in intervals]
    wandering = _wandering([blocks.mean[of, :3] for of in rows], intervals, blocks.quantum[:3], half)
    reasons = [
        interval.reason or _at_one_number(of, blocks, noise) or words
        for interval, of, words in zip(intervals, rows, wandering, strict=True)
    ]
    means = np.array([interval.mean for interval in intervals]).reshape(-1, 3)
    sizes = sizes_in_g(means, np.array([not reason for reason in reasons], bool))
    if sizes is not None:
        reasons = [
            reason or (f"size: {size:.2f} times that of the others" if abs(size - 1) > _ODD_SIZE else "")
            for reason, size in zip(reasons, sizes, strict=True)
        ]
    judged = [replace(interval, reason=reason) for interval, reason in zip(intervals, reasons, strict=True)]
    return judged, sizes is not None


def blocks_of_interval(interval: Interval, blocks: SignalBlocks) -> Integers:
    """The blocks in an interval, without its knocks."""
    rows = blocks.row
    inside = (rows >= interval.start) & (rows + blocks.size <= interval.stop)
    for start, stop in interval.knocks:
        inside &= (rows + blocks.size <= start) | (rows >= stop)
    return np.flatnonzero(inside)


def _at_one_number(rows: Integers, blocks: SignalBlocks, noise: Floats) -> str:
    """Check for axes where most samples are one number, the largest or smallest in the interval, although their noise exceeds
    the steps of the numbers. At the end of the range they are saturated, otherwise stuck; coarse steps alone are neither."""
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


def _wandering(means: list[Floats], intervals: list[Interval], quantum: Floats, half: int) -> list[str]:
    """Check for intervals whose means of half seconds scatter much more than those of the others. A hand that wanders by a
    degree, and a sensor that is heated in one attitude, pass."""
    sds = np.full((len(means), 3), np.nan)
    for sd, mean in zip(sds, means, strict=True):
        if (count := len(mean) // half) >= _FEWEST:
            sd[:] = mean[: count * half].reshape(count, half, 3).mean(1).std(0, ddof=1)
    if np.isfinite(sds[:, 0]).sum() < _FEWEST:
        return [""] * len(means)
    size = _WANDER_SHARE * float(np.median([np.linalg.norm(interval.mean) for interval in intervals]))
    times = np.nan_to_num(sds / np.maximum(_WANDER * np.nanmedian(sds, axis=0), np.maximum(size, quantum / 2)))
    return [
        f"restless: means of half seconds of axis {AXES[int(one.argmax())]} scatter by {one.max():.2g} times the limit"
        if one.max() > 1
        else ""
        for one in times
    ]
