"""Checks of intervals against each other: stuck or saturated axes, wandering means, sizes different from gravity.

No check assumes a sensor without bias. Sizes are relative to the rough ellipsoid of all intervals, and are not checked if there
are too few intervals to determine it.
"""

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tumblecal.ground.axes import AXES
from tumblecal.recordings.still.blocks import SignalBlocks
from tumblecal.recordings.still.rough_sensor import rough_sensor
from tumblecal.recordings.still.windows import Windows


@dataclass(frozen=True)
class Interval:
    """Rows `start` to `stop` of a recording, without those of `knocks` (pairs of rows).

    `reason`: why it is not used; empty if it is. `mean` (3): mean accelerations, in the recording's unit.
    """

    start: int
    stop: int
    start_s: float
    stop_s: float
    mean: NDArray[np.float64]
    knocks: tuple[tuple[int, int], ...] = ()
    reason: str = ""

    def as_dict(self) -> dict[str, Any]:
        """The interval as keys and values of a file."""
        record = asdict(self) | {"mean": self.mean.tolist(), "knocks": [list(pair) for pair in self.knocks]}
        return record | {"used": not self.reason}


# The size of readings at rest, after the rough bias, is gravity within this share, and within this many standard
# uncertainties.
_ODD_SIZE, _ODD_U = 0.3, 5.0
# Noise of this many steps of the numbers is resolved: it cannot vanish, and at most this share of samples can be the largest.
_RESOLVED, _SHARE_AT_END = 1.0, 0.5
# Wandering means of half seconds exceed those of other intervals by this factor, and this share of gravity.
_WANDER, _WANDER_SHARE, _FEWEST = 4.0, 0.03, 3


def judged(intervals: list[Interval], blocks: SignalBlocks, windows: Windows) -> tuple[list[Interval], bool]:
    """Intervals with the reasons why some are not used, and whether the attitudes sufficed to check sizes."""
    rows = [blocks_of_interval(interval, blocks) for interval in intervals]
    for reasons in (_saturation(rows, blocks, windows), _wandering(rows, intervals, blocks, windows)):
        intervals = [
            replace(interval, reason=interval.reason or reason)
            for interval, reason in zip(intervals, reasons, strict=True)
        ]
    return _of_odd_size(intervals)


def blocks_of_interval(interval: Interval, blocks: SignalBlocks) -> NDArray[np.int64]:
    """The blocks in an interval, without its knocks."""
    rows = blocks.row
    inside = (rows >= interval.start) & (rows + blocks.size <= interval.stop)
    for start, stop in interval.knocks:
        inside &= (rows + blocks.size <= start) | (rows >= stop)
    return np.flatnonzero(inside)


def _saturation(rows: list[NDArray[np.int64]], blocks: SignalBlocks, windows: Windows) -> list[str]:
    """Check for axes where most samples are one number, the largest or smallest in the interval, although their noise exceeds
    the steps of the numbers. At the end of the range they are saturated, otherwise stuck; coarse steps alone are neither."""
    resolved = (windows.noise[:3] > _RESOLVED * blocks.quantum[:3]) & (blocks.quantum[:3] > 0)
    reasons = []
    for blocks_of in rows:
        found = ""
        for sign, ends, at_ends in zip((1, -1), blocks.ends, blocks.at_ends, strict=True) if len(blocks_of) else ():
            end, limit = (sign * (sign * part).max(0) for part in (ends[blocks_of], ends))
            count = np.where(ends[blocks_of] == end, at_ends[blocks_of], 0).sum(0)
            for axis in np.flatnonzero(resolved & (count > _SHARE_AT_END * len(blocks_of) * blocks.size)).tolist():
                stays = end[axis] == limit[axis]
                found = (f"saturated: axis {AXES[axis]} stays at the end of its range") if stays else found
                found = found or f"stuck: axis {AXES[axis]} stays at one reading"
        reasons.append(found)
    return reasons


def _wandering(
    rows: list[NDArray[np.int64]], intervals: list[Interval], blocks: SignalBlocks, windows: Windows
) -> list[str]:
    """Check for intervals whose means of half seconds scatter much more than those of the others. A hand that wanders by a
    degree, and a sensor that is heated in one attitude, pass."""
    half = windows.length // 2
    sds = np.full((len(rows), 3), np.nan)
    for k, blocks_of in enumerate(rows):
        count = len(blocks_of) // half
        if count >= 3:
            sds[k] = blocks.mean[blocks_of[: count * half], :3].reshape(count, half, 3).mean(1).std(0, ddof=1)
    known = sds[np.isfinite(sds[:, 0])]
    if len(known) < _FEWEST:
        return [""] * len(rows)
    size = _WANDER_SHARE * float(np.median([np.linalg.norm(interval.mean) for interval in intervals]))
    limit = np.maximum(_WANDER * np.median(known, axis=0), np.maximum(size, blocks.quantum[:3] / 2))
    reasons = []
    for sd in sds:
        axis = int(np.argmax(np.nan_to_num(sd / limit)))
        times = sd[axis] / max(windows.noise[axis] / np.sqrt(half * blocks.size), 1e-300)
        words = (
            f"restless: means of half seconds of axis {AXES[axis]} scatter by {times:.0f} times what its noise explains"
        )
        reasons.append(words if sd[axis] > limit[axis] else "")
    return reasons


def _of_odd_size(intervals: list[Interval]) -> tuple[list[Interval], bool]:
    """Check for intervals in which the size of the readings is not gravity: they are not at rest, whatever their noise."""
    means = np.array([interval.mean for interval in intervals]).reshape(-1, 3)
    used = np.array([not interval.reason for interval in intervals], bool)
    sensor = rough_sensor(means[used])
    if sensor is None:
        return intervals, False
    sizes = np.linalg.norm(sensor.in_g(means), axis=1)
    odd = used & (np.abs(sizes - 1) > np.maximum(_ODD_SIZE, _ODD_U * sensor.u_of_size(means)))
    return [
        replace(interval, reason=f"size: {size:.2f} times that of the others") if refused else interval
        for interval, size, refused in zip(intervals, sizes, odd, strict=True)
    ], True
