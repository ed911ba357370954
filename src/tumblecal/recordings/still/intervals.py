"""Attitudes and intervals at rest: checks against each other for stuck or saturated axes, and for sizes different from gravity.

No check assumes a sensor without bias: cheap sensors have offsets of 0.25 to 0.6 g. Sizes are relative to the rough bias and
scale of all intervals, an axis-aligned ellipsoid through most of them, and are not checked if there are too few intervals to
determine it.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.samples import Floats, Integers
from tumblecal.ground.axes import AXES
from tumblecal.recordings.still.blocks import SignalBlocks


# Readings that differ by less than this have one attitude: the change of gravity in a turn by 10 degrees. Biases do not affect
# this difference, and changes of bias and scale factor with temperature are smaller.
ONE_ATTITUDE_G = 2 * float(np.sin(np.radians(10.0) / 2))
# Fewest attitudes for the six parameters of an ellipsoid and a test of it.
_FEWEST = 9
# Number of random subsets of six: with one third false intervals, all 400 have a false one with probability 1e-16.
_SUBSETS = 400
# Readings this close to an ellipsoid (relative to its radius) are on it: non-orthogonal axes and nonlinearity distort it.
_NEAR = 0.08
# Largest plausible bias of a triad (g), and largest ratio of its scales.
_LARGEST_BIAS, _LARGEST_RATIO = 0.9, 1.35


def grouped(means: Floats) -> tuple[Integers, list[Floats]]:
    """Groups of readings (rows, 3) in g that differ by less than `ONE_ATTITUDE_G` from the first of their group."""
    index, firsts = np.zeros(len(means), int), list[Floats]()
    for row, mean in enumerate(means):
        far = [float(np.linalg.norm(mean - first)) for first in firsts]
        if min(far, default=np.inf) > ONE_ATTITUDE_G:
            firsts.append(mean)
            far.append(0.0)
        index[row] = np.argmin(far)
    return index, firsts


def sizes_in_g(readings: Floats, used: NDArray[np.bool_]) -> Floats | None:
    """Sizes of the readings in g (n,) after rough bias and scale; None if the used ones are too few or too similar to determine
    these.

    Least squares on a x² + b y² + c z² + d x + e y + f z = 1 from subsets of six; the ellipsoid with most agreeing readings is
    fitted again to these.

    **Arguments:**

    - `readings`: means of intervals, in any unit, shape (n, 3). `used` (n,): mask of those that determine the ellipsoid.
    """
    known = readings[used]
    if not len(known):
        return None
    middle = np.median(known, axis=0)
    size = float(np.median(np.linalg.norm(known - middle, axis=1)))
    if not size:
        return None
    scaled, zero = (known - middle) / size, -middle / size
    if len(grouped(scaled)[1]) < _FEWEST:
        return None
    design = np.hstack([scaled**2, scaled])
    rng = np.random.default_rng(0)
    sixes = design[np.argsort(rng.random((_SUBSETS, len(known))), axis=1)[:, :6]]
    sixes = sixes[np.linalg.cond(sixes) < 1e4]
    found = _sizes(np.linalg.solve(sixes, np.ones((len(sixes), 6, 1)))[..., 0], scaled, zero)
    near = max(np.abs(found - 1) < _NEAR, key=np.count_nonzero, default=np.zeros(0, bool))
    if 2 * near.sum() <= len(near):
        return None
    solution = np.linalg.lstsq(design[near], np.ones(int(near.sum())), rcond=None)[0]
    sizes = _sizes(solution[None], (readings - middle) / size, zero)[0]
    return sizes if np.isfinite(sizes).all() else None


def _sizes(solutions: NDArray, readings: Floats, zero: NDArray) -> Floats:
    """Sizes of readings (n, 3) about the centres of ellipsoids, in their radii (solutions, n); infinite for an ellipsoid that
    is implausible for a sensor."""
    square, line = solutions[:, :3], solutions[:, 3:]
    with np.errstate(all="ignore"):
        centre = -line / (2 * square)
        radii = np.sqrt((1 + (square * centre**2).sum(1, keepdims=True)) / square)
        sizes = np.linalg.norm((readings - centre[:, None]) / radii[:, None], axis=2)
        biased = (np.abs(centre - zero) > _LARGEST_BIAS * radii).any(1)
        plausible = (square > 0).all(1) & (radii.max(1) <= _LARGEST_RATIO * radii.min(1)) & ~biased
    return np.where(plausible[:, None], sizes, np.inf)


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
