"""Axes that do not answer to gravity: the same reading in all attitudes, or that of another axis."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError


# Fewer attitudes say nothing, nor do those in which no axis changes by so much, in g.
_FEWEST, _TURNED_G = 4, 0.5
# An axis that changes by less than this share of the others has the same reading everywhere.
_SAME = 0.02
# Gravity that stays in a plane has one size there, within this share (unequal scales, misalignment); two intervals may differ.
_ONE_SIZE, _OTHERS = 0.15, 2


def require_axes_answer(source: str, dwells: Sequence[NDArray[np.float64]] | NDArray[np.float64]) -> None:
    """Refuse axes that do not answer although the triad is turned.

    An axis across which gravity never comes does not change either; the other two then see all of gravity: their readings lie
    on a circle. An axis is dead if they do not, or if it has one reading to the last digit while the others show noise.

    **Arguments:**

    - `source`: for the fault. `dwells`: samples of each attitude in g, shape (n, 3); a mean alone is one sample.

    **Raises:** `InputError` naming the axes.
    """
    means = np.array([dwell.mean(0) for dwell in dwells]).reshape(-1, 3)
    moved = np.ptp(means, axis=0) if len(means) else np.zeros(3)
    if len(means) < _FEWEST or moved.max() < _TURNED_G:
        return
    noisy = np.median([np.ptp(dwell, axis=0) > 0 for dwell in dwells], axis=0) > 0
    stuck, silent = list[int](), list[int]()
    for axis in np.flatnonzero(moved < _SAME * moved.max()).tolist():
        others = [other for other in range(3) if other != axis]
        if noisy[others].any() and all((dwell[:, axis] == dwells[0][0, axis]).all() for dwell in dwells):
            stuck.append(axis)
        elif not _on_circle(means[:, others]):
            silent.append(axis)
    # Of two that do not change, gravity may not have reached one.
    if dead := stuck or silent:
        names, do = ", ".join(AXES[axis] for axis in dead), "axis {} does" if len(dead) == 1 else "axes {} do"
        raise InputError(
            f"{source}: {do.format(names)} not answer: the same reading in all attitudes ({1e3 * means[0, dead[0]]:.4g} mg in "
            f"all {len(means)}; others change by up to {moved.max():.3g} g); check the channel and the column"
        )
    for first, second in combinations(range(3), 2):
        if not all((dwell[:, first] == dwell[:, second]).all() for dwell in dwells):
            continue
        third = 3 - first - second
        in_plane = np.stack([np.sqrt(2) * means[:, first], means[:, third]], axis=1)
        if noisy[[first, second]].all() or not _on_circle(in_plane):
            raise InputError(
                f"{source}: axes {AXES[first]} and {AXES[second]} have the same readings in every row: a channel or a column "
                "was taken twice; give each axis its column"
            )


def _on_circle(points: NDArray[np.float64]) -> bool:
    """Whether points (n, 2) lie about on a circle: least squares of |p|² = 2 c p + k, less their mean; if they lie on a line,
    whether they are the two ends of it."""
    points = points - points.mean(0)
    left, size, _ = np.linalg.svd(points, full_matrices=False)
    if size[1] < _SAME * size[0]:
        along = left[:, 0] * size[0]
        radii = np.abs(along - (along.max() + along.min()) / 2)
    else:
        design = np.hstack([2 * points, np.ones((len(points), 1))])
        solution = np.linalg.lstsq(design, (points**2).sum(1), rcond=None)[0]
        radii = np.linalg.norm(points - solution[:2], axis=1)
    usual = np.median(radii)
    return bool((np.abs(radii - usual) > _ONE_SIZE * usual).sum() < _OTHERS)
