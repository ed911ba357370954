"""Curves and thermal terms of a calibration for a device: at one temperature, or the bias as polynomials of third order."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from numpy.polynomial.polynomial import polyadd, polyfit, polypow, polyval

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import Term
from tumblecal.data.sensor_parameters import leaf_of
from tumblecal.data.temperature_curves import Curve
from tumblecal.devices.temperature_table import of_unknown_covariance
from tumblecal.ground.axes import AXES


# Temperature for thermal terms of a calibration that states none.
_ROOM_DEGC = 25.0
# Number of temperatures in a range for errors, and for fits of polynomials; highest power of PX4 and ArduPilot.
_GRID, _FIT_GRID, ORDER = 61, 1001, 3


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
    (degC): exact up to that order, otherwise a least-squares fit with equal weight over the range. Its curves are those of
    the bias only."""
    bias, curves = np.array(calibration.bias, float), calibration.temperature
    of_bias = {curve.parameter[-1]: curve for curve in curves.curves} if curves else {}
    grid, terms = np.linspace(*span, _FIT_GRID), [term for term in calibration.terms if not _in_polynomial(term)]
    for number, axis in enumerate(AXES):
        of_axis = [term for term in calibration.terms if _in_polynomial(term) and term.axis == axis]
        powers, spline = np.zeros(1), None
        for term in of_axis:
            powers = polyadd(powers, _powers(term, about_degc))
        if axis in of_bias:
            polynomial, spline = _curve_powers(of_bias[axis], about_degc, grid)
            powers = polyadd(powers, polynomial)
        if spline is not None or len(powers) > ORDER + 1:
            values = polyval(grid - about_degc, powers) + (0.0 if spline is None else spline)
            powers = polyfit(grid - about_degc, values, ORDER)
        bias[number] += powers[0]
        effect = of_axis[0].effect if of_axis else ""
        terms += [
            Term(axis, float(value), degc_power=power, reference_degc=about_degc, effect=effect)
            for power, value in enumerate(powers)
            if power and value
        ]
    known = calibration.parameters if curves is None else None
    return replace(calibration, bias=bias, temperature=None, parameters=known).with_terms(terms)


def _curve_powers(curve: Curve, about_degc: float, grid: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """The polynomial of a curve by powers of the temperature minus `about_degc`; for a spline zero, with values on a grid."""
    if curve.functions.knots_degc:
        return np.zeros(1), curve.coefficients @ curve.functions.values(grid)
    powers, step = np.zeros(1), [about_degc - curve.functions.reference_degc, 1.0]
    for power, value in enumerate(curve.coefficients, 1):
        powers = polyadd(powers, value * polypow(step, power))
    return powers, None


def bias_polynomials(calibration: Calibration, about_degc: float) -> Float[np.ndarray, "4 3"]:
    """The bias over temperature minus `bias`, g, by powers of the temperature minus `about_degc`, for each axis.

    **Raises:** `ValueError` for terms above third order.
    """
    table = np.zeros((ORDER + 1, 3))
    for term in calibration.terms:
        if _in_polynomial(term):
            powers = _powers(term, about_degc)
            table[: len(powers), AXES.index(term.axis)] += powers
    return table


def _in_polynomial(term: Term) -> bool:
    return term.thermal and term.of_bias


def _powers(term: Term, about_degc: float) -> np.ndarray:
    """A term of the bias by powers of the temperature minus `about_degc`, g."""
    return term.coefficient * polypow([about_degc - term.reference_degc, 1.0], term.degc_power)
