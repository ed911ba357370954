"""Readings in the wrong unit, axes exchanged or of the wrong sign: found before anything is fitted."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.ground.axes import AXES
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


_FACTORS = {
    "mg": 1e3,
    "m/s^2": STANDARD_GRAVITY_MS2,
    "g (in a column of mg)": 1e-3,
    "g (in a column of m/s^2)": 1 / STANDARD_GRAVITY_MS2,
}
# How far (ratio) a reading's size may be from a unit's factor and still be taken for it.
_NEAR = 1.3


@dataclass(frozen=True)
class MixUp:
    """A mix-up found: catalogue id, what it is in words; the readings put right."""

    label: str
    words: str


def put_right(
    readings: Float[np.ndarray, "positions 3"],
    expected: Float[np.ndarray, "positions 3"],
    names: tuple[str, ...],
) -> tuple[Float[np.ndarray, "positions 3"], list[MixUp]]:
    """Find mixed-up units and axes by comparing the readings with those of a perfect instrument.

    **Arguments:**

    - `readings`: as given, taken for g. `expected`: of a perfect instrument at the commanded angles, g.

    **Returns:** readings in g on the plan's axes, and what was found.
    """
    readings, found = readings.copy(), []
    sizes = np.linalg.norm(readings, axis=1)
    common = float(np.median(sizes))
    for words, factor in _FACTORS.items():
        if 1 / _NEAR < common / factor < _NEAR:
            readings, sizes = readings / factor, sizes / factor
            found.append(MixUp("unit_error", f"all readings are in {words}"))
            break
        odd = np.flatnonzero(np.abs(np.log(np.maximum(sizes, 1e-300) / factor)) < np.log(_NEAR))
        if len(odd) and 1 / _NEAR < common < _NEAR:
            readings[odd] /= factor
            sizes[odd] /= factor
            listed = ", ".join(names[k] for k in odd[:6]) + (" ..." if len(odd) > 6 else "")
            found.append(MixUp("unit_error", f"positions {listed} are in {words}"))
    if np.linalg.matrix_rank(np.hstack([expected, np.ones((len(expected), 1))]), tol=1e-3) < 4:
        return readings, found
    basis = np.hstack([expected, np.ones((len(expected), 1))])
    matrix = np.linalg.lstsq(basis, readings, rcond=None)[0][:3].T
    # Row a: which ideal inputs output a follows.
    source = np.argmax(np.abs(matrix), axis=1)
    leading = matrix[np.arange(3), source]
    if len(set(source.tolist())) < 3 or (np.any(np.abs(leading) < 0.5) and not np.any(np.abs(leading) > 2)):
        return readings, found
    for axis in range(3):
        for words, factor in _FACTORS.items():
            if 1 / _NEAR < abs(leading[axis]) / factor < _NEAR:
                readings[:, axis] /= factor
                found.append(MixUp("unit_error", f"axis {AXES[axis]} is in {words}"))
    if np.any(source != np.arange(3)) or np.any(leading < 0):
        right = np.empty_like(readings)
        for axis in range(3):
            right[:, source[axis]] = np.sign(leading[axis]) * readings[:, axis]
        terms = [f"column {AXES[a]} is {'-' if leading[a] < 0 else ''}{AXES[source[a]]}" for a in range(3)]
        found.append(MixUp("axis_map", "; ".join(terms)))
        readings = right
    return readings, found
