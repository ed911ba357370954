"""Checks of the numbers in a calibration file and in its budget: each fault names the file and the key."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np
from jaxtyping import Float

from tumblecal.data.sensor_parameters import SENSOR, SensorParameters, leaf_of, triad_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown


# Larger numbers are not those of a sensor, and would overflow.
LARGEST = 1e12
# The matrix of a triad is near 1; readings in a wrong unit give at most a thousand.
MOST_SCALE = 2e3
ROUNDING = 1e-9
# Matrix and bias may differ by this much (1, g) from what the parameters say: more than any rounding, float32 included, and
# far below the uncertainty of a calibration.
_SAME = 1e-6


def is_number(value: object) -> TypeGuard[int | float]:
    """Whether this is a number, not beyond `LARGEST`."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return -LARGEST <= value <= LARGEST


def numbers(path: Path, content: dict[str, Any], key: str, shape: tuple[int, ...], within: str = "") -> np.ndarray:
    """The table of numbers under a key.

    **Arguments:**

    - `within`: the dotted path of `content` in the file, for messages.

    **Raises:** `InputError` if it is missing, has a wrong shape, or an entry that is not a number.
    """
    named = f"{path}: {within}{key}"
    if key not in content:
        raise InputError(f"{named} is missing")
    if wrong := next(_no_numbers(content[key], len(shape)), None):
        raise InputError(f"{named}{wrong[0]}: {shown(wrong[1])} is not a number")
    try:
        values = np.array(content[key], float)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{named} is not a table of numbers") from error
    if values.shape != shape or not np.all(np.abs(values) <= LARGEST):
        size = " x ".join(map(str, shape))
        raise InputError(f"{named} must have {size} finite numbers, none beyond {LARGEST:g}")
    return values


def _no_numbers(table: object, depth: int, at: str = "") -> Iterator[tuple[str, object]]:
    """Cells that are not numbers, with their place; numpy would convert them, or reject them without their place."""
    if depth and isinstance(table, list):
        for place, cell in enumerate(table):
            yield from _no_numbers(cell, depth - 1, f"{at}.{place}")
    elif not depth and type(table) not in (int, float):
        yield at, table


def checked_matrix(matrix: Float[np.ndarray, "3 3"], file: Path) -> Float[np.ndarray, "3 3"]:
    """A matrix of finite numbers.

    **Raises:** `InputError` for a matrix that cannot be that of a triad.
    """
    scales = np.linalg.svd(matrix, compute_uv=False)
    if not 1 / MOST_SCALE < scales[-1] <= scales[0] < MOST_SCALE:
        raise InputError(
            f"{file}: matrix: its scale is {scales[-1]:.3g} to {scales[0]:.3g}, so it cannot be that of a triad (about 1)"
        )
    return matrix


def covariance(path: Path, content: dict[str, Any], size: int, within: str = "", key: str = "covariance") -> np.ndarray:
    """The covariance of `size` numbers under a key.

    **Raises:** `InputError` for an invalid covariance.
    """
    table = numbers(path, content, key, (size, size), within)
    largest = float(np.max(np.abs(table)))
    symmetric = np.max(np.abs(table - table.T)) <= ROUNDING * largest
    least = np.min(np.linalg.eigvalsh(table + table.T))
    if not symmetric or least < -ROUNDING * max(largest, 1e-300):
        raise InputError(f"{path}: {within}{key}: not one (it must be symmetric, and no variance negative)")
    return table


def parameters(path: Path, stated: dict[str, Any]) -> SensorParameters:
    """The table `parameters`.

    **Raises:** `InputError` for names that are not those of a sensor and its mountings, and for numbers as above.
    """
    names = stated.get("names")
    if not (isinstance(names, list) and all(isinstance(name, str) for name in names) and len(set(names)) == len(names)):
        raise InputError(f"{path}: parameters: names must be different texts")
    faults = [
        f"{path}: parameters.names: no parameter {shown(name)} of a triad or its mountings; parameters: {', '.join(SENSOR)}, "
        "dtheta_x, dtheta_y, dtheta_z"
        for name in names
        if name not in SENSOR and leaf_of(name) != "dtheta"
    ]
    if missing := [name for name in SENSOR if name not in names]:
        faults.append(f"{path}: parameters.names: {', '.join(missing)} missing; they must be as calibrate writes them")
    if faults:
        raise InputError(faults)
    size, within = len(names), "parameters."
    values, determined = numbers(path, stated, "values", (size,), within), stated.get("determined", [True] * size)
    if not (isinstance(determined, list) and len(determined) == size and all(type(own) is bool for own in determined)):
        raise InputError(f"{path}: parameters: determined must be true or false for each name")
    left = tuple([name for name, own in zip(names, determined, strict=True) if not own])
    own = covariance(path, stated, size, within)
    if np.any(negative := np.diag(own) < 0):
        name = names[int(np.argmax(negative))]
        raise InputError(f"{path}: parameters.covariance: the variance of {name} is negative")
    return SensorParameters(tuple(names), values, own, left)


def agreeing(
    path: Path, matrix: Float[np.ndarray, "3 3"], bias: Float[np.ndarray, "3"], own: SensorParameters
) -> SensorParameters:
    """Parameters that agree with matrix and bias.

    **Raises:** `InputError` if they contradict each other, as after a manual change of one of them.
    """
    sensor = own.of(SENSOR).values
    triad = triad_of(sensor)
    far = np.flatnonzero(np.abs(bias - sensor[3:6]) > _SAME * max(1.0, float(np.max(np.abs(bias)))))
    faults = [f"bias.{k}: {bias[k]:.9g} g, but parameters say {sensor[3 + k]:.9g}" for k in far]
    # The matrix undoes the triad of the parameters: their product is 1 whatever unit the readings are in.
    if np.any(np.abs(matrix @ triad - np.eye(3)) > _SAME):
        made = np.linalg.inv(matrix)
        row, column = np.unravel_index(np.argmax(np.abs(made - triad)), (3, 3))
        faults.append(
            f"matrix: its inverse has {made[row, column]:.9g} in row {row + 1}, column {column + 1}, but dK and gamma in "
            f"parameters make {triad[row, column]:.9g}"
        )
    if faults:
        advice = "the file contradicts itself, as after a manual change; use the file of calibrate"
        raise InputError([f"{path}: {fault}: {advice}" for fault in faults])
    return own
