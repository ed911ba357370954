"""Rough bias and scale of a triad from its intervals at rest: an axis-aligned ellipsoid through most of them.

Cheap sensors have offsets of 0.25 to 0.6 g: before these are removed, size and direction of their readings show little.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


# Fewest attitudes for the six parameters of an ellipsoid and a test of it; attitudes closer than this (g) are equal.
_FEWEST, _SAME_G = 9, 0.17
# Number of random subsets of six: with one third false intervals, all 400 have a false one with probability 1e-16.
_SUBSETS = 400
# Readings this close to an ellipsoid (relative to its radius) are on it: non-orthogonal axes and nonlinearity distort it.
_NEAR = 0.08
# Largest plausible bias of a triad (g), and largest ratio of its scales.
_LARGEST_BIAS, _LARGEST_RATIO = 0.9, 1.35


@dataclass(frozen=True)
class RoughSensor:
    """`centre` and `radii` (3): readings of the axes at 0 g, and their change at 1 g. `covariance` (6, 6): covariance of the
    coefficients in units of the readings' scatter, for readings minus `origin[0]`, divided by `origin[1]`."""

    centre: NDArray[np.float64]
    radii: NDArray[np.float64]
    covariance: NDArray[np.float64]
    origin: tuple[NDArray[np.float64], float]

    def in_g(self, readings: NDArray[np.float64]) -> NDArray[np.float64]:
        """Readings (n, 3) without bias, in g."""
        return (readings - self.centre) / self.radii

    def u_of_size(self, readings: NDArray[np.float64]) -> NDArray[np.float64]:
        """Standard uncertainty of the size of readings (n, 3), g: it is large far from the fitted readings."""
        design = _design((readings - self.origin[0]) / self.origin[1])
        return _NEAR / 2 * np.sqrt(1 + np.einsum("ni,ij,nj->n", design, self.covariance, design))


def rough_sensor(readings: NDArray[np.float64]) -> RoughSensor | None:
    """The ellipsoid through most of the readings; None if they are too few or too similar to determine it.

    Least squares on a x² + b y² + c z² + d x + e y + f z = 1 from subsets of six; the ellipsoid with most agreeing readings is
    fitted again to these.

    **Arguments:**

    - `readings`: means of intervals, in any unit, shape (n, 3).
    """
    middle = np.median(readings, axis=0) if len(readings) else np.zeros(3)
    size = float(np.median(np.linalg.norm(readings - middle, axis=1))) if len(readings) else 0.0
    if not size or _attitudes((readings - middle) / size) < _FEWEST:
        return None
    design, zero = _design((readings - middle) / size), -middle / size
    rng = np.random.default_rng(0)
    subsets = np.argsort(rng.random((_SUBSETS, len(readings))), axis=1)[:, :6]
    sixes = design[subsets]
    sixes = sixes[np.linalg.cond(sixes) < 1e4]
    found = [
        near
        for coefficients in np.linalg.solve(sixes, np.ones((len(sixes), 6, 1)))[..., 0]
        if (near := _near(coefficients, design, zero)).any()
    ]
    if not found:
        return None
    near = max(found, key=np.count_nonzero)
    solution = np.zeros(6)
    for _ in range(10):
        solution = np.asarray(np.linalg.lstsq(design[near], np.ones(int(near.sum())), rcond=None)[0], np.float64)
        again = _near(solution, design, zero)
        if not again.any() or (again == near).all():
            break
        near = again
    shape = _shape(solution, zero)
    if shape is None or 2 * near.sum() <= len(near) or _attitudes(((readings - middle) / size)[near]) < _FEWEST:
        return None
    covariance = np.asarray(np.linalg.pinv(design[near].T @ design[near]), np.float64)
    return RoughSensor(middle + size * shape[0], size * shape[1], covariance, (middle, size))


def _design(readings: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.hstack([readings**2, readings])


def _shape(
    solution: NDArray[np.float64], zero: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Centre and radii of an ellipsoid; None if it is not one, or implausible for a sensor."""
    square, line = solution[:3], solution[3:]
    if (square <= 0).any():
        return None
    centre = -line / (2 * square)
    radii = np.sqrt((1 + (square * centre**2).sum()) / square)
    bad = radii.max() > _LARGEST_RATIO * radii.min() or (np.abs(centre - zero) > _LARGEST_BIAS * radii).any()
    return None if bad else (centre, radii)


def _near(solution: NDArray[np.float64], design: NDArray[np.float64], zero: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mask of readings near the ellipsoid; empty if it is implausible for a sensor."""
    shape = _shape(solution, zero)
    if shape is None:
        return np.zeros(len(design), bool)
    return np.abs(np.linalg.norm((design[:, 3:] - shape[0]) / shape[1], axis=1) - 1) < _NEAR


def _attitudes(readings: NDArray[np.float64]) -> int:
    """Approximate number of different attitudes among readings in g."""
    distinct = np.zeros((0, 3))
    for reading in readings:
        if not len(distinct) or np.linalg.norm(distinct - reading, axis=1).min() > _SAME_G:
            distinct = np.vstack([distinct, reading])
    return len(distinct)
