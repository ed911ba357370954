"""Parameters over temperature as a table that a device or a spreadsheet interpolates linearly."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import Calibration
from tumblecal.data.sensor_parameters import SENSOR, triad_of
from tumblecal.data.temperature_curves import Curve, TemperatureCurves, order_of_covariance
from tumblecal.ground.errors import InputError
from tumblecal.ground.temperature_functions import TemperatureFunctions


_MOST_ROWS = 2000
# The last row of a table is not closer to the row before it than this share of the step.
_SHORTEST = 1e-6


def table_degc(span: tuple[float, float], step_degc: float) -> Float[np.ndarray, " rows"]:
    """The temperatures of a table: from the lowest in steps, and the highest.

    **Raises:** `InputError` for a step that gives more than 2000 rows.
    """
    low, high = span
    if not (high - low) / step_degc < _MOST_ROWS:
        raise InputError(
            f"a table from {low:g} to {high:g} degC in steps of {step_degc:g} degC has more than {_MOST_ROWS} rows; "
            "give a longer step"
        )
    steps = np.arange(0.0, (high - low) / step_degc - _SHORTEST)
    return np.append(low + steps * step_degc, high)


def in_table(calibration: Calibration, degc: Float[np.ndarray, " rows"]) -> Calibration:
    """The calibration with parameters that are interpolated linearly between their values at some temperatures."""
    curves = calibration.temperature
    if curves is None or not len(degc):
        return calibration
    values = calibration.sensor.of(SENSOR).values + curves.at(degc)
    at_reference, linear = linear_curves(degc, values, curves.reference_degc)
    return replace(
        calibration,
        matrix=np.linalg.inv(triad_of(at_reference)),
        bias=at_reference[3:6],
        temperature=linear,
        parameters=None,
    )


def linear_curves(
    degc: Float[np.ndarray, " rows"], values: Float[np.ndarray, "rows 9"], reference_degc: float | None = None
) -> tuple[Float[np.ndarray, "9"], TemperatureCurves | None]:
    """The sensor parameters at a reference temperature, and their linear splines through the rows of a table; None if no
    parameter changes. The covariance is zero (unknown).

    **Raises:** `InputError` for temperatures that do not increase, or a single row.
    """
    if len(degc) < 2 or not np.all(np.diff(degc) > 0):
        raise InputError("a table over temperature needs two or more rows, and temperatures that increase")
    span = float(degc[0]), float(degc[-1])
    reference = float(np.mean(span)) if reference_degc is None else float(np.clip(reference_degc, *span))
    functions = TemperatureFunctions(1, reference, span, tuple(degc[1:-1].tolist()))
    slopes = np.diff(values, axis=0) / np.diff(degc)[:, None]
    coefficients = np.diff(slopes, axis=0, prepend=0.0)
    at_reference = np.array([np.interp(reference, degc, column) for column in values.T])
    curves = [Curve(name, functions, c) for name, c in zip(SENSOR, coefficients.T, strict=True) if np.any(c)]
    return at_reference, of_unknown_covariance(curves)


def of_unknown_covariance(curves: Sequence[Curve]) -> TemperatureCurves | None:
    """Curves with a covariance of zeros (unknown); None for no curves."""
    order = order_of_covariance(curves)
    return TemperatureCurves(tuple(curves), np.zeros((len(order), len(order))), order) if curves else None
