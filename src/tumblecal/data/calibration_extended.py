"""The inverse of an extended sensor model: nonlinear and thermal terms beside the linear correction, solved exactly.

The reading is `A = diag(1 + dK) u + bias + terms(u, T)`, u being the ideal input along each sensitive axis. A term is
`{"axis": "z", "coefficient": c, "powers": [i, j, k], "kind": ..., "per_degc": ...}`, meaning `c u_x^i u_y^j u_z^k`;
kind `abs` or `sign` takes the absolute value or the sign of that product; with `per_degc` it is multiplied by
`T - reference_degc`, with `per_hour` (a drift) by the hours since `reference_s`. Coefficients are in g, degC and h.
"""

from functools import reduce
from typing import Any

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import KINDS, checked
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError


# Fixed-point steps shrink the error by the terms' slope, some 1e-3 each: this is rounding of a reading near 1 g.
TOLERANCE = 1e-14
MOST_STEPS = 60
# Rows at a time: what stays in the processor's cache is several times as fast.
_BLOCK = 1 << 13
_KINDS_OF = {"temperature_degc": "temperature", "time_s": "drift"}
# A step larger than this many times the readings runs away.
FARTHEST = 3.0


def corrected(
    calibration: Calibration,
    readings: Float[np.ndarray, "rows 3"],
    temperature_degc: Float[np.ndarray, " rows"] | float | None = None,
    time_s: Float[np.ndarray, " rows"] | float | None = None,
) -> Float[np.ndarray, "rows 3"]:
    """Specific force in g from readings in g, by the linear correction and the terms in `calibration.extra["terms"]`.

    **Arguments:**

    - `temperature_degc`, `time_s`: of every row, or one for all; needed when a term depends on it.

    **Raises:** `InputError` for a term that is not understood, a missing temperature or time, one of another number of rows, or
    readings of another shape, or so far outside the model that no input explains them.
    """
    if np.ndim(readings) == 0 or np.shape(readings)[-1] != 3:
        raise InputError(f"readings have the shape {np.shape(readings)}; (rows, 3) is wanted")
    readings = np.asarray(readings)
    terms = checked(calibration.extra.get("terms", []))
    for name, values in (("temperature_degc", temperature_degc), ("time_s", time_s)):
        if values is None and name in columns_needed(calibration):
            raise InputError(f"this calibration has {_KINDS_OF[name]} terms: the data need a column {name}")
        if values is not None and np.ndim(values) and np.shape(values) != readings.shape[:1]:
            raise InputError(f"{name} has the shape {np.shape(values)}; one number, or {readings.shape[:1]}, is wanted")
    degc, time = (
        None if given is None else np.broadcast_to(given, len(readings)) for given in (temperature_degc, time_s)
    )
    force = np.empty(readings.shape[::-1]).T
    with np.errstate(all="ignore"):  # what runs away ends in an error
        for first in range(0, len(readings), _BLOCK):
            rows = slice(first, first + _BLOCK)
            if terms:
                factors = [_factor(term, degc, time, rows) for term in terms]
                force[rows] = _inverted(calibration, terms, factors, readings[rows])
            else:
                force[rows] = calibration.linear(readings[rows])
    return force


def columns_needed(calibration: Calibration) -> tuple[str, ...]:
    """Columns beside the readings without which its terms mean nothing."""
    terms = checked(calibration.extra.get("terms", []))
    needed = {"temperature_degc": "per_degc", "time_s": "per_hour"}
    return tuple(name for name, key in needed.items() if any(term.get(key) for term in terms))


def _factor(
    term: dict[str, Any], temperature_degc: np.ndarray | None, time_s: np.ndarray | None, rows: slice
) -> np.ndarray | float:
    """What a term's coefficient is multiplied by beside the product of the inputs."""
    factor: np.ndarray | float = term["coefficient"]
    if term.get("per_degc") and temperature_degc is not None:
        factor = factor * (np.asarray(temperature_degc[rows], float) - term["reference_degc"])
    if term.get("per_hour") and time_s is not None:
        factor = factor * ((np.asarray(time_s[rows], float) - term["reference_s"]) / 3600)
    return factor


def _inverted(
    calibration: Calibration,
    terms: list[dict[str, Any]],
    factors: list[np.ndarray | float],
    readings: Float[np.ndarray, "rows 3"],
) -> Float[np.ndarray, "rows 3"]:
    lower = np.linalg.inv(calibration.matrix)
    to_inputs = (lower / np.diag(lower)[:, None]).T
    force = calibration.linear(readings)
    for _ in range(MOST_STEPS):
        better = calibration.linear(readings - _added(terms, factors, force @ to_inputs))
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
    """What the terms add to the readings at given inputs, g; without a temperature as at one degree from the reference."""
    return _added(terms, [_factor(term, temperature_degc, None, slice(None)) for term in terms], inputs)


def _added(
    terms: list[dict[str, Any]], factors: list[np.ndarray | float], inputs: Float[np.ndarray, "rows 3"]
) -> Float[np.ndarray, "rows 3"]:
    added = np.zeros(inputs.shape[::-1]).T
    for term, factor in zip(terms, factors, strict=True):
        powers = [inputs[:, k] for k, power in enumerate(term["powers"]) for _ in range(power)]
        product = reduce(np.multiply, powers) if powers else np.ones(1)
        added[:, AXES.index(term["axis"])] += factor * KINDS[term.get("kind", "product")](product)
    return added
