"""Checks of arrays that a user gives: numbers, shapes, and the unit of the readings."""

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from tumblecal.chain import Chain
from tumblecal.chain.nominal import Triad
from tumblecal.data.gravity_size import FACTORS, unit_of
from tumblecal.ground.errors import InputError


def numbers_in_g(name: str, values: ArrayLike) -> np.ndarray:
    """The values as an array.

    **Raises:** `InputError` if they are not numbers.
    """
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: give numbers in g ({error})") from error


def stated_sd(values: ArrayLike, count: int) -> np.ndarray:
    """Standard deviations of the readings of `count` positions, g, that broadcast to (count, 3).

    **Raises:** `InputError` for a wrong shape, or if one is not above 0.
    """
    stated = numbers_in_g("noise_sd", values)
    if not np.all(stated > 0):
        raise InputError("noise_sd must be above 0")
    if stated.ndim > 2 or any(
        size not in (1, full) for size, full in zip(stated.shape[::-1], (3, count), strict=False)
    ):
        raise InputError(
            f"noise_sd has the shape {stated.shape}; give one number, one for each axis (3,), one for each position "
            f"({count}, 1), or ({count}, 3)"
        )
    return stated


def require_g(chain: Chain, readings: Float[np.ndarray, "... 3"]) -> None:
    """Reject readings of accelerometers at rest (a chain with a triad) whose median norm is not 0.5 to 2 g. All zero: none yet.

    **Raises:** `InputError` with the unit that they seem to have.
    """
    norms = np.linalg.norm(readings, axis=-1)
    norms = norms[np.isfinite(norms)]
    if not np.any(norms) or not any(isinstance(link, Triad) for link in chain.links):
        return
    size = float(np.median(norms))
    if not 0.5 < size < 2.0:
        unit = unit_of(size)
        cure = "check their unit and scale" if unit is None else f"they look like {unit}: divide by {FACTORS[unit]:g}"
        raise InputError(f"readings: the median norm is {size:.4g}, but 1 g at rest; {cure}")
