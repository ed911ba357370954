"""The thermal terms of a calibration as a device takes them: evaluated at one temperature, or as polynomials of third order."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from numpy.polynomial.polynomial import polyadd, polyfit, polypow, polyval

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import Term
from tumblecal.ground.axes import AXES


# Where a calibration states no temperature, its thermal terms are evaluated around this one.
_ROOM_DEGC = 25.0
# Temperatures of a range at which errors are looked for, and at which polynomials are fitted; highest power of PX4, ArduPilot.
_GRID, _FIT_GRID, ORDER = 13, 1001, 3


def held_degc(calibration: Calibration, span: tuple[float, float] | None) -> float:
    """The temperature (degC) at which matrix and bias are exported: that from which the thermal terms count; if they count from
    several, the mean of the data. It is within the range `span`, where one is given."""
    references = {term.reference_degc for term in calibration.terms if term.thermal}
    stated = calibration.temperature_degc
    degc = references.pop() if len(references) == 1 else _ROOM_DEGC if stated is None else stated
    return degc if span is None else float(np.clip(degc, *span))


def temperatures(calibration: Calibration, span: tuple[float, float] | None) -> Float[np.ndarray, " grid"]:
    """The temperatures (degC) at which errors are looked for."""
    return np.array([held_degc(calibration, None)]) if span is None else np.linspace(*span, _GRID)


def at_temperature(calibration: Calibration, degc: float, terms: Collection[Term]) -> Calibration:
    """The calibration without some of its terms. Thermal ones of bias, scale factor and cross terms leave the value that they
    have at this temperature in bias and matrix."""
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
    kept = [term for term in calibration.terms if term not in terms]
    return replace(calibration, matrix=np.linalg.inv(forward), bias=bias).with_terms(kept)


def of_third_order(calibration: Calibration, span: tuple[float, float]) -> Calibration:
    """The calibration with its bias over temperature as one polynomial of third order for each axis, about a temperature within
    the range (degC): exact up to that order, otherwise the least squares over the range."""
    about, bias = held_degc(calibration, span), np.array(calibration.bias, float)
    grid, terms = np.linspace(*span, _FIT_GRID), [term for term in calibration.terms if not _in_polynomial(term)]
    for number, axis in enumerate(AXES):
        own = [term for term in calibration.terms if _in_polynomial(term) and term.axis == axis]
        if not own:
            continue
        powers = np.zeros(1)
        for term in own:
            powers = polyadd(powers, _powers(term, about))
        if len(powers) > ORDER + 1:
            powers = polyfit(grid - about, polyval(grid - about, powers), ORDER)
        bias[number] += powers[0]
        terms += [
            Term(axis, float(value), degc_power=power, reference_degc=about, effect=own[0].effect)
            for power, value in enumerate(powers)
            if power and value
        ]
    return replace(calibration, bias=bias).with_terms(terms)


def bias_polynomials(calibration: Calibration, about_degc: float) -> Float[np.ndarray, "4 3"]:
    """The bias over temperature less `bias`, g, by powers of the temperature less `about_degc`, for each axis.

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
    """A term of the bias by powers of the temperature less `about_degc`, g."""
    return term.coefficient * polypow([about_degc - term.reference_degc, 1.0], term.degc_power)
