"""Search for three columns that measure gravity: their means over calm stretches lie on an ellipsoid of its size.

The axes of the ellipsoid are along the three columns (a bias and a scale factor each): a triad with small misalignments.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


_FEWEST_ROWS, _MOST_ROWS, _WINDOWS = 12, 60, 2000
# With more attitudes than any procedure has, the columns are not at rest.
_MOST_ATTITUDES = 300
# A window is calm if its dispersion is at most this many times that of the quietest fifth.
_QUIET_SHARE, _CALM = 0.2, 3.0
# Two stretches have one attitude if their means differ by less than this share of the readings' size.
_SAME = 0.1
FEWEST_ATTITUDES, _FEWEST_FOR_SCALES = 6, 10
# Dispersion of the fitted lengths: for MEMS triads below 1 %, with a misalignment of 2 degrees below 3 %.
_MOST_DISPERSION = 0.04
# Offsets reach 0.6 g; an axis that senses less than half of gravity does not show its offset.
_LARGEST_OFFSET, _LEAST_RANGE = 0.8, 0.5
_MOST_UNEQUAL = 1.25


@dataclass(frozen=True)
class StillMeans:
    """Means (k, n) and standard deviations (k, n) of windows of the rows of n columns."""

    means: NDArray[np.float64]
    sd: NDArray[np.float64]

    def calm(self, columns: list[int]) -> NDArray[np.bool_]:
        """Mask of calm windows, by the dispersion of some columns."""
        spread = np.sqrt((self.sd[:, columns] ** 2).sum(1))
        if not len(spread):
            return np.zeros(0, bool)
        quiet = np.quantile(spread, _QUIET_SHARE)
        # With coarse steps there may be no dispersion at all.
        size = np.median(np.linalg.norm(self.means[:, columns], axis=1))
        return spread <= max(_CALM * quiet, 2e-3 * size)

    def attitudes(self, columns: list[int]) -> NDArray[np.float64]:
        """The means (m, 3) of the attitudes in the calm windows, each once."""
        calm = self.means[self.calm(columns)][:, columns]
        if not len(calm):
            return calm
        least = _SAME * float(np.median(np.linalg.norm(calm, axis=1)))
        begins = np.flatnonzero(np.linalg.norm(np.diff(calm, axis=0), axis=1) > least) + 1
        found: list[NDArray[np.float64]] = []
        for stretch in np.split(calm, begins):
            mean = np.median(stretch, axis=0)
            if not found or (np.linalg.norm(np.array(found) - mean, axis=1) > least).all():
                found.append(mean)
            if len(found) > _MOST_ATTITUDES:
                return calm[:0]
        return np.array(found)


@dataclass(frozen=True)
class Ellipsoid:
    """The size of gravity in three columns; their biases and the dispersion of the lengths relative to it."""

    size: float
    bias: NDArray[np.float64]
    dispersion: float
    attitudes: int

    @property
    def fits(self) -> bool:
        """Whether the lengths are equal."""
        return self.dispersion <= _MOST_DISPERSION

    @property
    def usual(self) -> bool:
        """Whether the biases are plausible for an accelerometer."""
        return bool((np.abs(self.bias) <= _LARGEST_OFFSET).all())


def still_means(values: NDArray[np.float64]) -> StillMeans:
    """The windows of rows (m, n), in order; rows with a missing number are skipped."""
    values = values[np.isfinite(values).all(1)]
    length = int(np.clip(len(values) // _WINDOWS, _FEWEST_ROWS, _MOST_ROWS))
    windows = values[: len(values) // length * length].reshape(-1, length, values.shape[1])
    with np.errstate(over="ignore", invalid="ignore"):
        return StillMeans(windows.mean(1), windows.std(1))


def ellipsoid(attitudes: NDArray[np.float64]) -> Ellipsoid | None:
    """The ellipsoid through attitudes (m, 3); None for too few attitudes, or attitudes that do not determine each axis.

    With one scale factor |m|^2 - 2 b.m = r^2 - |b|^2, linear in the bias b and the right side; with three, each square has
    a coefficient.
    """
    count = len(attitudes)
    if count < FEWEST_ATTITUDES:
        return None
    unit = float(np.median(np.linalg.norm(attitudes - attitudes.mean(0), axis=1)))
    if not unit > 0:
        return None
    m = attitudes / unit
    best = None
    for scales in (False, True) if count >= _FEWEST_FOR_SCALES else (False,):
        found = _fitted(m, scales=scales)
        if found is not None and (best is None or found[2] < best[2]):
            best = found
    if best is None:
        return None
    size, bias, dispersion = best
    if (np.ptp(m, axis=0) < _LEAST_RANGE * size).any():
        return None
    return Ellipsoid(size * unit, bias / size, dispersion, count)


def _fitted(m: NDArray[np.float64], *, scales: bool) -> tuple[float, NDArray[np.float64], float] | None:
    """Size, bias, and dispersion of the lengths for the degrees of freedom; None for implausible scale factors."""
    if scales:
        # x^2 = -B y^2 - C z^2 + 2 b_x x + 2 B b_y y + 2 C b_z z + r^2
        matrix = np.column_stack([-(m[:, 1:] ** 2), 2 * m, np.ones(len(m))])
        found, _, rank, _ = np.linalg.lstsq(matrix, m[:, 0] ** 2, rcond=1e-9)
        squares = np.array([1.0, *found[:2]])
        if rank < 6 or (squares <= 0).any() or squares.max() > _MOST_UNEQUAL**2 * squares.min():
            return None
        bias, parameters = found[2:5] / squares, 6
        m, bias = m * np.sqrt(squares), bias * np.sqrt(squares)
    else:
        matrix = np.column_stack([2 * m, np.ones(len(m))])
        found, _, rank, _ = np.linalg.lstsq(matrix, (m**2).sum(1), rcond=1e-9)
        if rank < 4:
            return None
        squares, bias, parameters = np.ones(3), found[:3], 4
    lengths = np.linalg.norm(m - bias, axis=1)
    size = float(lengths.mean())
    dispersion = (
        float(np.sqrt(((lengths / size - 1) ** 2).sum() / (len(m) - parameters))) if len(m) > parameters else np.inf
    )
    # In the units of the columns: the geometric mean of the three scale factors.
    common = float(np.sqrt(squares).prod() ** (1 / 3))
    return size / common, bias / common, dispersion
