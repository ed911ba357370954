"""The size of gravity in readings of a triad at rest: a wrong scale, an axis without 1 g, or a triad that moved is named.

Nothing is corrected. Readings in several attitudes have sizes near 1 g, because biases are far below 1 g and scale factor
errors below 10 %. If 1 g was subtracted from an axis, the sizes are equal about that point. If the triad moved, the sizes
differ even about the ellipsoid that fits the readings best, with any bias, scale factors and non-orthogonality.
"""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from tumblecal.ground.axes import AXES
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2
from tumblecal.ground.suggested_command import suggested


if TYPE_CHECKING:
    from tumblecal.data.positions import PositionSet


# Readings of 1 g in each unit, in the unit of the column.
FACTORS = {
    "mg": 1e3,
    "m/s^2": STANDARD_GRAVITY_MS2,
    "g (in a column of mg)": 1e-3,
    "g (in a column of m/s^2)": 1 / STANDARD_GRAVITY_MS2,
}
# Largest ratio between the size of a reading and the factor of a unit for which the unit is accepted.
NEAR = 1.3
# Ranges of devices differ by powers of two, up to this one; scale factor errors are below 10 %.
_HIGHEST_POWER, _SAME_SCALE = 5, 1.1
# Sizes of gravity at rest, g; without a sphere median sizes, with biases up to 0.6 g.
_AT_REST = (0.75, 1.35)
# A sphere needs this many readings, their dispersion in the worst direction over that in the best, and their standard deviation
# in the best over their size, because noise in one attitude has all directions too.
_FEWEST_OF_SPHERE, _ALL_SIDES, _ABOVE_NOISE = 6, 0.2, 0.05
# Standard deviation of the sizes, g: below the first about the right point (a bias of 0.13 g), above the second about zero;
# deviations above the third number are gross errors of a reading.
_EQUAL_G, _UNEQUAL_G, _LARGEST_G = 0.08, 0.2, 0.5
# Standard deviation of the sizes about the best ellipsoid. Means at rest repeat within some mg, also in the hand.
_STILL, _FEWEST, _GROSS = 0.04, 80, 3.0
# The size of readings that are all zero, so that it has a logarithm.
_NOTHING_G = 1e-9


def unit_of(size: float) -> str | None:
    """The unit other than g in which readings of this size (g) are 1 g; None if a different range explains the size better."""
    away = {words: abs(np.log(size / factor)) for words, factor in FACTORS.items()}
    nearest = min(away, key=lambda words: away[words])
    return nearest if away[nearest] < min(np.log(NEAR), abs(np.log(size / power_of_two(size)))) else None


def gravity_size(readings: Float[np.ndarray, "positions 3"]) -> float:
    """The size of gravity in readings: radius of the sphere through them, or their median size if they do not determine it."""
    usual, size = _without_gross_errors(readings), float(np.median(np.linalg.norm(readings, axis=1)))
    if len(usual) >= _FEWEST_OF_SPHERE:
        _, spread, _ = np.linalg.svd(usual - usual.mean(0), full_matrices=False)
        if spread[2] > _ALL_SIDES * spread[0] and spread[0] > _ABOVE_NOISE * size * np.sqrt(len(usual)):
            return max(sphere_of(usual)[1], _NOTHING_G)
    return max(size, _NOTHING_G)


def sphere_of(readings: Float[np.ndarray, "positions 3"]) -> tuple[Float[np.ndarray, "3"], float]:
    """Centre and radius of the sphere through readings, by linear least squares: |a|^2 = 2 c'a + r^2 - |c|^2."""
    terms = np.column_stack([2 * readings, np.ones(len(readings))])
    solution = np.linalg.lstsq(terms, np.sum(readings**2, axis=1))[0]
    centre = solution[:3]
    return centre, float(np.sqrt(max(solution[3] + centre @ centre, 0.0)))


def _without_gross_errors(readings: Float[np.ndarray, "positions 3"]) -> Float[np.ndarray, "some 3"]:
    """Readings without gross errors, which would determine a sphere or an ellipsoid alone."""
    sizes = np.maximum(np.linalg.norm(readings, axis=1), _NOTHING_G)
    return readings[np.abs(np.log(sizes / np.median(sizes))) < np.log(_GROSS)]


def size_fault(readings: Float[np.ndarray, "positions 3"]) -> str:
    """What is wrong with the size of gravity in readings (g) at rest, and a proposal; "" if it may be 1 g."""
    return _subtracted(readings) or _scale(readings)


def _scale(readings: Float[np.ndarray, "positions 3"]) -> str:
    size = gravity_size(readings)
    if _AT_REST[0] < size < _AT_REST[1]:
        return ""
    factor, finding = power_of_two(size), f"the readings have a size of about {size:.4g} g, but 1 g at rest"
    if factor != 1.0 and 1 / _SAME_SCALE < size / factor < _SAME_SCALE:
        return (
            f"{finding}: {factor:g} times the force, as with a wrong full-scale range of the device. Correct the range, or "
            f"{f'divide the readings by {factor:g}' if factor > 1 else f'multiply the readings by {1 / factor:g}'}"
        )
    return (
        f"{finding}: a wrong scale. If they are counts, divide them by the counts per g of the data sheet; otherwise check the "
        "unit and the full-scale range"
    )


def _subtracted(readings: Float[np.ndarray, "positions 3"]) -> str:
    """An axis from which 1 g was subtracted, or to which it was added."""
    if _sizes_about(readings, np.zeros(3))[0] < _UNEQUAL_G:
        return ""
    for axis, name in enumerate(AXES):
        for sign, words, cure in ((-1.0, "subtracted from", "add 1 g to"), (1.0, "added to", "subtract 1 g from")):
            other, size = _sizes_about(readings, sign * np.eye(3)[axis])
            if other < _EQUAL_G and 1 / _SAME_SCALE < size < _SAME_SCALE:
                return (
                    f"1 g was {words} axis {name}: without this, the size of all readings is about {size:.3g} g. Record the "
                    f"readings with gravity, or {cure} axis {name}"
                )
    return ""


def moving_fault(data: "PositionSet") -> str:
    """How much the sizes of the readings differ if the triad was not at rest, and a proposal; "" if it may have been."""
    usual = _without_gross_errors(data.readings)
    if len(usual) < _FEWEST or (sd := _sd_of_sizes(usual)) < _STILL:
        return ""
    return (
        f"the sizes of the readings differ by {100 * sd:.2g} % (standard deviation) after the best fit of bias, scale factors "
        "and non-orthogonality, so the triad was not at rest, or an axis was saturated. Positions are means at rest. To find "
        f"the intervals at rest of a recording, run: {reduce_command(data)}"
    )


def reduce_command(data: "PositionSet") -> str:
    """The command that finds the intervals at rest, if the rows are samples of a recording."""
    return suggested("reduce", data.comments.get("reduced_from", data.source), "--static")


def power_of_two(size: float) -> float:
    """The nearest factor between full-scale ranges of a device."""
    return float(2.0 ** np.clip(np.round(np.log2(size)), -_HIGHEST_POWER, _HIGHEST_POWER))


def _sizes_about(readings: Float[np.ndarray, "positions 3"], centre: Float[np.ndarray, "3"]) -> tuple[float, float]:
    """Standard deviation of the sizes about a point (gross errors limited), and their median, g."""
    sizes = np.linalg.norm(readings - centre, axis=1)
    size = float(np.median(sizes))
    return float(np.std(np.clip(sizes - size, -_LARGEST_G, _LARGEST_G))), size


def _sd_of_sizes(readings: Float[np.ndarray, "positions 3"]) -> float:
    """Relative standard deviation (robust) of the sizes about the best ellipsoid a'Ma + v'a = 1."""
    x, y, z = readings.T
    terms = np.stack([x * x, y * y, z * z, x * y, x * z, y * z, x, y, z], axis=1)
    found = np.linalg.lstsq(terms, np.ones(len(terms)))[0]
    square = np.diag(found[:3])
    square[[0, 0, 1], [1, 2, 2]] = square[[1, 2, 2], [0, 0, 1]] = found[3:6] / 2
    # The size about the centre has the square (a'Ma + v'a + c) / (1 + c).
    whole = 1.0 + found[6:] @ np.linalg.pinv(square) @ found[6:] / 4
    return float(1.4826 * np.median(np.abs(terms @ found - 1.0)) / abs(2 * whole))


def gravity_warnings(data: "PositionSet") -> list[str]:
    """The faults of the size of gravity. With few attitudes a bias may change the median size, so there are none."""
    faults = (size_fault(data.readings), moving_fault(data)) if len(data) >= _FEWEST_OF_SPHERE else ()
    return [fault for fault in faults if fault]
