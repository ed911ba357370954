"""The exact inverse of an extended sensor model: linear correction with nonlinear, thermal and drift terms.

The reading is `A = diag(1 + dK) u + bias + terms(u, T)`, with the ideal input u along each sensitive axis. With curves of
temperature dK, bias and u are those at the temperature of the row.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration_terms import Term
from tumblecal.data.triad import Triad
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError


# Each fixed-point step multiplies the error by the slope of the terms, some 1e-3. This is the rounding of a reading of 1 g.
TOLERANCE = 1e-14
MOST_STEPS = 60
# Rows in one block: a block that fits the CPU cache is several times faster.
_BLOCK = 1 << 13
_KINDS_OF = {"temperature_degc": "temperature", "time_s": "drift"}
# The iteration diverges if a step is larger than this many times the readings.
FARTHEST = 3.0


def corrected(
    triad: Callable[[np.ndarray | None], Triad],
    terms: Sequence[Term],
    needed: Sequence[str],
    readings: Float[np.ndarray, "rows 3"],
    temperature_degc: Float[np.ndarray, " rows"] | float | None = None,
    time_s: Float[np.ndarray, " rows"] | float | None = None,
) -> Float[np.ndarray, "rows 3"]:
    """Specific force in g from readings in g, by the linear correction and the terms of a calibration.

    A term of kind `sign` leaves a gap of readings at zero input: a reading in this gap is mapped to its middle.

    **Arguments:**

    - `triad`: the linear correction of rows, by their temperatures. `needed`: columns on which triad or terms depend.
    - `temperature_degc`, `time_s`: of each row, or one for all rows; required if they are needed.

    **Raises:** `InputError` for a missing temperature or time, a wrong number of rows, readings of a wrong shape, or readings
    so far outside the model that it cannot be inverted.
    """
    if np.ndim(readings) == 0 or np.shape(readings)[-1] != 3:
        raise InputError(f"readings have the shape {np.shape(readings)}; it must be (rows, 3)")
    readings, columns = np.asarray(readings), dict[str, np.ndarray | None]()
    for name, values in (("temperature_degc", temperature_degc), ("time_s", time_s)):
        if values is None and name in needed:
            raise InputError(f"this calibration has {_KINDS_OF[name]} terms: the data need a column {name}")
        if values is not None and np.ndim(values) and np.shape(values) != readings.shape[:1]:
            raise InputError(f"{name} has the shape {np.shape(values)}; it must be one number, or {readings.shape[:1]}")
        columns[name] = None if values is None else np.broadcast_to(np.asarray(values, float), len(readings))
    force = np.empty(readings.shape[::-1]).T
    with np.errstate(all="ignore"):  # a divergent iteration ends in an error
        for first in range(0, len(readings), _BLOCK):
            rows = slice(first, first + _BLOCK)
            degc, time = (None if column is None else column[rows] for column in columns.values())
            of_rows = triad(degc)
            force[rows] = (
                _inverted(of_rows, terms, degc, time, readings[rows]) if terms else of_rows.force(readings[rows])
            )
    return force


def _inverted(
    triad: Triad,
    terms: Sequence[Term],
    degc: np.ndarray | None,
    time: np.ndarray | None,
    readings: Float[np.ndarray, "rows 3"],
) -> Float[np.ndarray, "rows 3"]:
    factors = [term.factor(degc, time) for term in terms]
    jumps = 2 * sum(np.max(np.abs(factor)) for term, factor in zip(terms, factors, strict=True) if term.kind == "sign")
    farthest = FARTHEST * max(1.0, float(np.max(np.abs(readings), initial=0.0)))
    force = triad.force(readings)
    before = np.full_like(force, np.nan)
    for _ in range(MOST_STEPS):
        better = triad.force(readings - _added(terms, factors, triad.inputs(force)))
        change = np.abs(better - force)
        tolerance = TOLERANCE * max(1.0, float(np.max(np.abs(better), initial=0.0)))
        if (largest := np.max(change, initial=0.0)) <= tolerance:
            return better
        if not largest <= farthest:
            break
        # In a gap the sign changes with every step; all other steps converge to zero.
        if jumps and largest <= 2 * jumps and np.all((change <= tolerance) | (np.abs(better - before) <= tolerance)):
            return (better + force) / 2
        before, force = force, better
    raise InputError(
        "the terms of this calibration cannot be inverted for these readings: they are too far outside its range"
    )


def values(
    terms: Sequence[Term],
    inputs: Float[np.ndarray, "rows 3"],
    temperature_degc: Float[np.ndarray, " rows"] | float | None,
) -> Float[np.ndarray, "rows 3"]:
    """Contribution of the terms to the readings at given inputs, g; without a temperature, one degree from the reference."""
    degc = None if temperature_degc is None else np.asarray(temperature_degc)
    return _added(terms, [term.factor(degc, None) for term in terms], inputs)


def _added(
    terms: Sequence[Term], factors: list[np.ndarray | float], inputs: Float[np.ndarray, "rows 3"]
) -> Float[np.ndarray, "rows 3"]:
    added = np.zeros(inputs.shape[::-1]).T
    for term, factor in zip(terms, factors, strict=True):
        added[:, AXES.index(term.axis)] += factor * term.of_inputs(inputs)
    return added
