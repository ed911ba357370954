"""Rough bias and scale of a triad, from its still intervals alone: an axis-aligned ellipsoid that most of them lie on.

Cheap sensors have offsets of 0.25 to 0.6 g: before these are taken off, size and direction of their readings say little.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


# So many attitudes give the six numbers of an ellipsoid and a test of it; nearer ones than this (in g) are one.
_FEWEST, _SAME_G = 9, 0.17
# Subsets of six from which one without outliers is found: of intervals a third of which are false, all 400 have some in 1e-16.
_SUBSETS = 400
# Readings this near to an ellipsoid (in its radius) lie on it: non-orthogonal axes and nonlinearity bend it.
_NEAR = 0.08
# No triad has a larger bias (in g), or axes of more unequal scale.
_LARGEST_BIAS, _LARGEST_RATIO = 0.9, 1.35


@dataclass(frozen=True)
class RoughSensor:
    """`centre` and `radii` (3): what the axes read at 0, and their change at 1 g. `covariance` (6, 6): of the coefficients in
    units of the readings' scatter, for readings less `origin[0]`, divided by `origin[1]`."""

    centre: NDArray[np.float64]
    radii: NDArray[np.float64]
    covariance: NDArray[np.float64]
    origin: tuple[NDArray[np.float64], float]

    def in_g(self, readings: NDArray[np.float64]) -> NDArray[np.float64]:
        """Readings (n, 3) without bias, in g."""
        return (readings - self.centre) / self.radii

    def u_of_size(self, readings: NDArray[np.float64]) -> NDArray[np.float64]:
        """How well the size of readings (n, 3) is known, in g: far from those that it came from it is not."""
        design = _design((readings - self.origin[0]) / self.origin[1])
        return _NEAR / 2 * np.sqrt(1 + np.einsum("ni,ij,nj->n", design, self.covariance, design))


def rough_sensor(readings: NDArray[np.float64]) -> RoughSensor | None:
    """The ellipsoid that most of the readings lie on; None where they are too few or too much alike to tell it.

    Least squares on a x² + b y² + c z² + d x + e y + f z = 1 from subsets of six; the one that most others agree with is fitted
    again to these.

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
        for own in np.linalg.solve(sixes, np.ones((len(sixes), 6, 1)))[..., 0]
        if (near := _near(own, design, zero)).any()
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
    """Centre and radii of an ellipsoid; None where it is none, or that of no sensor."""
    square, line = solution[:3], solution[3:]
    if (square <= 0).any():
        return None
    centre = -line / (2 * square)
    radii = np.sqrt((1 + (square * centre**2).sum()) / square)
    bad = radii.max() > _LARGEST_RATIO * radii.min() or (np.abs(centre - zero) > _LARGEST_BIAS * radii).any()
    return None if bad else (centre, radii)


def _near(solution: NDArray[np.float64], design: NDArray[np.float64], zero: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which readings lie near the ellipsoid; none where it is that of no sensor."""
    shape = _shape(solution, zero)
    if shape is None:
        return np.zeros(len(design), bool)
    return np.abs(np.linalg.norm((design[:, 3:] - shape[0]) / shape[1], axis=1) - 1) < _NEAR


def _attitudes(readings: NDArray[np.float64]) -> int:
    """How many different attitudes there are among readings in g, about."""
    kept = np.zeros((0, 3))
    for own in readings:
        if not len(kept) or np.linalg.norm(kept - own, axis=1).min() > _SAME_G:
            kept = np.vstack([kept, own])
    return len(kept)
