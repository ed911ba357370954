"""The inverse of an extended sensor model: nonlinear and thermal terms beside the linear correction, solved exactly.

The reading is `A = diag(1 + dK) u + bias + terms(u, T)`, u being the ideal input along each sensitive axis. A term is
`{"axis": "z", "coefficient": c, "powers": [i, j, k], "kind": ..., "per_degc": ...}`, meaning `c u_x^i u_y^j u_z^k`;
kind `abs` or `sign` takes the absolute value or the sign of that product; with `per_degc` it is multiplied by
`T - reference_degc`. Coefficients are in g and degC.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import Calibration, is_number
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown


KINDS = {"product": lambda value: value, "abs": np.abs, "sign": np.sign}
# Fixed-point steps shrink the error by the terms' slope, some 1e-3 each: this is rounding of a reading near 1 g.
TOLERANCE = 1e-14
MOST_STEPS = 60
# A step larger than this many times the readings runs away.
FARTHEST = 3.0


def corrected(
    calibration: Calibration,
    readings: Float[np.ndarray, "rows 3"],
    temperature_degc: Float[np.ndarray, " rows"] | None = None,
) -> Float[np.ndarray, "rows 3"]:
    """Specific force in g from readings in g, by the linear correction and the terms in `calibration.extra["terms"]`.

    **Arguments:**

    - `temperature_degc`: of every row; needed when a term depends on it.

    **Raises:** `InputError` for a term that is not understood, a missing temperature, or readings so far outside the
    model that no input explains them.
    """
    terms = checked(calibration.extra.get("terms", []))
    if not terms:
        return calibration.linear(readings)
    if temperature_degc is None and any(term.get("per_degc") for term in terms):
        raise InputError("this calibration has temperature terms: the data need a column temperature_degc")
    with np.errstate(all="ignore"):  # what runs away ends in the error below
        return _inverted(calibration, terms, readings, temperature_degc)


def _inverted(
    calibration: Calibration,
    terms: list[dict[str, Any]],
    readings: Float[np.ndarray, "rows 3"],
    temperature_degc: np.ndarray | None,
) -> Float[np.ndarray, "rows 3"]:
    lower = np.linalg.inv(calibration.matrix)
    to_inputs = (lower / np.diag(lower)[:, None]).T
    force = calibration.linear(readings)
    for _ in range(MOST_STEPS):
        better = calibration.linear(readings - values(terms, force @ to_inputs, temperature_degc))
        change = np.max(np.abs(better - force), initial=0.0)
        force = better
        if change <= TOLERANCE * max(1.0, float(np.max(np.abs(force), initial=0.0))):
            return force
        if not change <= FARTHEST * max(1.0, float(np.max(np.abs(readings), initial=0.0))):
            break
    raise InputError(
        "the terms of this calibration cannot be inverted for these readings: they are too far outside its range"
    )


def values(
    terms: list[dict[str, Any]], inputs: Float[np.ndarray, "rows 3"], temperature_degc: np.ndarray | None
) -> Float[np.ndarray, "rows 3"]:
    """What the terms add to the readings at given inputs, g."""
    added = np.zeros_like(inputs)
    for term in terms:
        product = np.prod(inputs ** np.asarray(term["powers"]), axis=1)
        value = term["coefficient"] * KINDS[term.get("kind", "product")](product)
        if term.get("per_degc") and temperature_degc is not None:
            value = value * (np.asarray(temperature_degc, float) - term["reference_degc"])
        added[:, AXES.index(term["axis"])] += value
    return added


def checked(terms: object) -> list[dict[str, Any]]:
    """The terms of a calibration file.

    **Raises:** `InputError` naming the first that is not understood.
    """
    if not isinstance(terms, list):
        raise InputError("calibration: terms is not a list")
    for number, term in enumerate(terms):
        if not _understood(term):
            raise InputError(f"calibration: term {number + 1} is not understood: {shown(term)}")
    return terms


def _understood(term: object) -> bool:
    if not isinstance(term, dict):
        return False
    powers, kind, per_degc = term.get("powers"), term.get("kind", "product"), term.get("per_degc", False)
    return (
        term.get("axis") in AXES
        and is_number(term.get("coefficient"))
        and isinstance(powers, list)
        and len(powers) == 3
        and all(type(power) is int and 0 <= power <= 9 for power in powers)
        and isinstance(kind, str)
        and kind in KINDS
        and (not per_degc or is_number(term.get("reference_degc")))
    )
