"""Check for axes that do not respond to gravity: one reading in all attitudes, or the readings of another axis."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from tumblecal.capture.decoding.samples import Floats
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError


# Fewest attitudes for the check, and smallest change of some axis between them, g.
_FEWEST, _TURNED_G = 4, 0.5
# An axis that changes by less than this share of the others has one reading in all attitudes.
_SAME = 0.02
# Gravity in a plane has a constant size, within this share (unequal scales, misalignment); two intervals may differ.
_ONE_SIZE, _OTHERS = 0.15, 2


def require_axes_answer(source: str, dwells: Sequence[Floats] | Floats) -> None:
    """Check that all axes respond to gravity when the triad is turned.

    An axis along which gravity is always zero does not change either; the other two axes then sense all of gravity, and their
    readings are on a circle. An axis is dead if they are not, or if its reading is exactly constant while the others show
    noise.

    **Arguments:**

    - `source`: name for the fault. `dwells`: samples of each attitude in g, shape (n, 3); a mean alone is one sample.

    **Raises:** `InputError` with the axes.
    """
    means = np.array([dwell.mean(0) for dwell in dwells]).reshape(-1, 3)
    if len(means) < _FEWEST or (moved := np.ptp(means, axis=0)).max() < _TURNED_G:
        return
    noisy = np.median([np.ptp(dwell, axis=0) > 0 for dwell in dwells], axis=0) > 0
    stuck, constant = list[str](), list[str]()
    for axis in np.flatnonzero(moved < _SAME * moved.max()).tolist():
        others = np.delete(np.arange(3), axis)
        if noisy[others].any() and all((dwell[:, axis] == dwells[0][0, axis]).all() for dwell in dwells):
            stuck.append(AXES[axis])
        elif not _on_circle(means[:, others]):
            constant.append(AXES[axis])
    # If two axes do not change, one of them may be without gravity.
    if dead := stuck or constant:
        verb = "axis {} does" if len(dead) == 1 else "axes {} do"
        raise InputError(
            f"{source}: {verb.format(', '.join(dead))} not respond: the same reading in all attitudes "
            f"({1e3 * means[0, AXES.index(dead[0])]:.4g} mg in all {len(means)}; others change by up to {moved.max():.3g} g); "
            "check the channel and the column"
        )
    for first, second in combinations(range(3), 2):
        in_plane = means[:, [first, 3 - first - second]] * [np.sqrt(2), 1]
        sure = noisy[[first, second]].all() or not _on_circle(in_plane)
        if sure and all((dwell[:, first] == dwell[:, second]).all() for dwell in dwells):
            raise InputError(
                f"{source}: axes {AXES[first]} and {AXES[second]} have the same readings in every row: a channel or a column "
                "was taken twice; give each axis its column"
            )


def _on_circle(points: Floats) -> bool:
    """Whether points (n, 2) are approximately on a circle, by least squares of |p|² = 2 c p + k after their mean; for points on
    a line, whether they are its two ends."""
    points = points - points.mean(0)
    size = np.linalg.svd(points, compute_uv=False)
    centre = (points.max(0) + points.min(0)) / 2
    if size[1] >= _SAME * size[0]:
        design = np.hstack([2 * points, np.ones((len(points), 1))])
        centre = np.linalg.lstsq(design, (points**2).sum(1), rcond=None)[0][:2]
    radii = np.linalg.norm(points - centre, axis=1)
    usual = np.median(radii)
    return bool((np.abs(radii - usual) > _ONE_SIZE * usual).sum() < _OTHERS)
