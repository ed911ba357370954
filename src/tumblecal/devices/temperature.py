"""The thermal terms of a calibration for a device: evaluated at one temperature, or as polynomials of third order."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from numpy.polynomial.polynomial import polyadd, polyfit, polypow, polyval

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import Term
from tumblecal.ground.axes import AXES


# Temperature for thermal terms of a calibration that states none.
_ROOM_DEGC = 25.0
# Number of temperatures in a range for errors, and for fits of polynomials; highest power of PX4 and ArduPilot.
_GRID, _FIT_GRID, ORDER = 13, 1001, 3


def export_degc(calibration: Calibration, span: tuple[float, float] | None) -> float:
    """The temperature (degC) of the exported matrix and bias: the reference of curves and thermal terms; if there are several,
    the mean of the data. It is limited to the range `span`, if given."""
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
    return replace(calibration, matrix=np.linalg.inv(forward), bias=bias).with_terms(others)


def of_third_order(calibration: Calibration, span: tuple[float, float]) -> Calibration:
    """The calibration with its bias over temperature as one polynomial of third order for each axis, about a temperature in
    the range (degC): exact up to that order, otherwise a least-squares fit over the range."""
    about, bias = export_degc(calibration, span), np.array(calibration.bias, float)
    grid, terms = np.linspace(*span, _FIT_GRID), [term for term in calibration.terms if not _in_polynomial(term)]
    for number, axis in enumerate(AXES):
        of_axis = [term for term in calibration.terms if _in_polynomial(term) and term.axis == axis]
        if not of_axis:
            continue
        powers = np.zeros(1)
        for term in of_axis:
            powers = polyadd(powers, _powers(term, about))
        if len(powers) > ORDER + 1:
            powers = polyfit(grid - about, polyval(grid - about, powers), ORDER)
        bias[number] += powers[0]
        terms += [
            Term(axis, float(value), degc_power=power, reference_degc=about, effect=of_axis[0].effect)
            for power, value in enumerate(powers)
            if power and value
        ]
    return replace(calibration, bias=bias).with_terms(terms)


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
