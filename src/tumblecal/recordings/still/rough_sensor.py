"""Rough bias and scale of a triad from its intervals at rest: an axis-aligned ellipsoid through most of them.

Cheap sensors have offsets of 0.25 to 0.6 g: before these are removed, size and direction of their readings show little.
"""

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.samples import Floats, Integers


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
