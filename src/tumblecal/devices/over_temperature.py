"""Curves and thermal terms of a calibration for a device: at one temperature, as polynomials of third order, or as a table."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from numpy.polynomial import Polynomial

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import Term
from tumblecal.data.sensor_parameters import SENSOR, leaf_of, triad_of
from tumblecal.data.temperature_curves import Curve, TemperatureCurves, order_of_covariance
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.temperature_functions import TemperatureFunctions


# Temperature for thermal terms of a calibration that states none.
_ROOM_DEGC = 25.0
# Number of temperatures in a range for errors, and for fits of polynomials; highest power of PX4 and ArduPilot.
_GRID, _FIT_GRID, ORDER = 61, 1001, 3
# A contribution below this within the range is rounding of a fit, g.
_ROUNDING_G = 1e-13
# Most rows of a table; its last row is not closer to the row before it than this share of the step.
_MOST_ROWS, _SHORTEST = 2000, 1e-6


def export_degc(calibration: Calibration, span: tuple[float, float] | None, at_degc: float | None = None) -> float:
    """The temperature (degC) of the exported matrix and bias: `at_degc`, or the reference of curves and thermal terms; if there
    are several, the mean of the data. It is limited to the range `span`, if given."""
    if at_degc is not None:
        return at_degc
    references = {term.reference_degc for term in calibration.terms if term.thermal}
    if calibration.temperature is not None:
        references.add(calibration.temperature.reference_degc)
    stated = calibration.temperature_degc
    degc = references.pop() if len(references) == 1 else _ROOM_DEGC if stated is None else stated
    return degc if span is None else float(np.clip(degc, *span))


def temperatures(calibration: Calibration, span: tuple[float, float] | None) -> Float[np.ndarray, " grid"]:
    """The temperatures (degC) at which errors are computed."""
    return np.array([export_degc(calibration, None)]) if span is None else np.linspace(*span, _GRID)


def at_temperature(calibration: Calibration, degc: float, terms: Collection[Term]) -> Calibration:
    """The calibration without some of its terms. The values of thermal terms of bias, scale factor and cross terms at this
    temperature are included in bias and matrix."""
    forward, bias = np.linalg.inv(calibration.matrix), calibration.bias.copy()
    to_inputs = forward / np.diag(forward)[:, None]
    for term in terms:
        axis, value = AXES.index(term.axis), float(term.factor(np.array(degc), None))
        if not term.thermal or term.kind != "product" or sum(term.powers) > 1:
            continue
        if term.of_bias:
            bias[axis] += value
        else:
            forward[axis] += value * to_inputs[term.powers.index(1)]
    others = [term for term in calibration.terms if term not in terms]
    known = calibration.parameters if calibration.temperature is None else None
    return replace(calibration, matrix=np.linalg.inv(forward), bias=bias, parameters=known).with_terms(others)


def with_curves_of_bias(calibration: Calibration, degc: float) -> Calibration:
    """The calibration with the curves of the bias only; all other parameters are those at this temperature."""
    fixed, curves = calibration.at(degc, extrapolate=True), calibration.temperature
    of_bias = [curve for curve in curves.curves if leaf_of(curve.parameter) == "bias"] if curves else []
    if not of_bias:
        return fixed
    return replace(fixed, bias=calibration.bias, parameters=None, temperature=of_unknown_covariance(of_bias))


def of_third_order(calibration: Calibration, span: tuple[float, float], about_degc: float) -> Calibration:
    """The calibration with its bias over temperature as one polynomial of third order for each axis, about a temperature
    (degC): a least-squares fit with equal weight over the range, exact up to that order. Its curves are those of the bias
    only."""
    bias, curves, degc = calibration.bias.astype(float), calibration.temperature, np.linspace(*span, _FIT_GRID)
    changes = np.zeros((_FIT_GRID, len(SENSOR))) if curves is None else curves.at(degc)
    terms = [term for term in calibration.terms if not _in_polynomial(term)]
    for number, axis in enumerate(AXES):
        name, of_axis = f"bias_{axis}", [t for t in calibration.terms if _in_polynomial(t) and t.axis == axis]
        curve = next((curve for curve in curves.curves if curve.parameter == name), None) if curves else None
        if curve is None and not of_axis:
            continue
        values = np.asarray(sum((term.factor(degc, None) for term in of_axis), changes[:, SENSOR.index(name)]))
        orders = [term.degc_power for term in of_axis] + ([ORDER if curve.knots_degc else curve.order] if curve else [])
        fitted = Polynomial.fit(degc - about_degc, values, min(max(orders), ORDER)).convert().coef
        powers = np.where(np.abs(fitted) * np.ptp(span) ** np.arange(len(fitted)) > _ROUNDING_G, fitted, 0.0)
        bias[number] += powers[0]
        effect = of_axis[0].effect if of_axis else ""
        terms += polynomial_terms(axis, powers, about_degc, effect)
    known = calibration.parameters if curves is None else None
    return replace(calibration, bias=bias, temperature=None, parameters=known).with_terms(terms)


def polynomial_terms(axis: str, powers: np.ndarray, reference_degc: float, effect: str = "") -> list[Term]:
    """The terms of a bias by powers of the temperature minus a reference, g; the constant is no term."""
    return [
        Term(axis, float(value), degc_power=power, reference_degc=reference_degc, effect=effect)
        for power, value in enumerate(powers)
        if power and value
    ]


def bias_polynomials(calibration: Calibration, about_degc: float) -> Float[np.ndarray, "4 3"]:
    """The bias over temperature minus `bias`, g, by powers of the temperature minus `about_degc`, for each axis.

    **Raises:** `ValueError` for terms above third order.
    """
    table = np.zeros((ORDER + 1, len(AXES)))
    for term in filter(_in_polynomial, calibration.terms):
        powers = term.coefficient * Polynomial([about_degc - term.reference_degc, 1.0]) ** term.degc_power
        table[: term.degc_power + 1, AXES.index(term.axis)] += np.asarray(powers.coef, float)
    return table


def _in_polynomial(term: Term) -> bool:
    return term.thermal and term.of_bias


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
    return of_table(degc, values, curves.reference_degc, like=calibration)


def of_table(
    degc: Float[np.ndarray, " rows"],
    values: Float[np.ndarray, "rows 9"],
    reference_degc: float | None = None,
    like: Calibration | None = None,
) -> Calibration:
    """The calibration of a device that interpolates the sensor parameters linearly between the rows of a table, as linear
    splines with unknown covariance (zero).

    **Arguments:**

    - `reference_degc`: by default the middle of the table. `like`: a calibration with the other entries.

    **Raises:** `InputError` for temperatures that do not increase, a single row, or a triad without an inverse.
    """
    if len(degc) < 2 or not np.all(np.diff(degc) > 0):
        raise InputError("a table over temperature needs two or more rows, and temperatures that increase")
    span = float(degc[0]), float(degc[-1])
    reference = float(np.mean(span)) if reference_degc is None else float(np.clip(reference_degc, *span))
    functions = TemperatureFunctions(1, reference, span, tuple(degc[1:-1].tolist()))
    coefficients = np.diff(np.diff(values, axis=0) / np.diff(degc)[:, None], axis=0, prepend=0.0).T
    at_reference = np.array([np.interp(reference, degc, column) for column in values.T])
    curves = [Curve(name, functions, c) for name, c in zip(SENSOR, coefficients, strict=True) if np.any(c)]
    return of_numbers(
        inverse(triad_of(at_reference), "diag(1 + dK) T"),
        at_reference[3:6],
        temperature=of_unknown_covariance(curves),
        like=like,
    )


def of_unknown_covariance(curves: Sequence[Curve]) -> TemperatureCurves | None:
    """Curves with a covariance of zeros (unknown); None for no curves."""
    order = order_of_covariance(curves)
    return TemperatureCurves(tuple(curves), np.zeros((len(order), len(order))), order) if curves else None


def of_numbers(
    matrix: Float[np.ndarray, "3 3"],
    bias: Float[np.ndarray, "3"],
    terms: Sequence[Term] = (),
    temperature: TemperatureCurves | None = None,
    like: Calibration | None = None,
) -> Calibration:
    """The calibration of a file that states no uncertainty (a covariance of zeros); `like`: with the other entries."""
    like = like or Calibration(matrix, bias, np.zeros((12, 12)))
    stated = replace(like, matrix=matrix, bias=bias, temperature=temperature, parameters=None)
    return stated.with_terms(terms) if terms else stated


def inverse(matrix: Float[np.ndarray, "3 3"], name: str) -> Float[np.ndarray, "3 3"]:
    """The inverse of a matrix with this name in a file.

    **Raises:** `InputError` for a singular matrix.
    """
    try:
        return np.linalg.inv(matrix)
    except np.linalg.LinAlgError as error:
        raise InputError(f"{name} cannot be inverted") from error
