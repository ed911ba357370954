"""A polynomial in one variable as one finding: the dependence in words, and its coefficients about one reference."""

from collections.abc import Iterator, Sequence
from math import comb

import numpy as np

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.causes.together import polynomials
from tumblecal.effects.effect import MEAN, elapsed
from tumblecal.effects.environment import REFERENCE_DEGC
from tumblecal.ground.axes import AXES
from tumblecal.ground.numbers_shown import rounded_together
from tumblecal.ground.units import factor
from tumblecal.report.cause_words import display_unit, size_words, with_undetected


_ORDINALS = {1: "first", 2: "second", 3: "third", 4: "fourth", 5: "fifth"}


def by_finding(causes: Sequence[Cause]) -> list[tuple[Cause, ...]]:
    """Causes in their order; the powers of one polynomial together, the lowest first."""
    together = {min(numbers): numbers for numbers in polynomials([cause.slot for cause in causes])}
    later = {number for numbers in together.values() for number in numbers} - together.keys()
    return [tuple([causes[k] for k in together.get(n, (n,))]) for n in range(len(causes)) if n not in later]


def polynomial_words(diagnosis: Diagnosis, causes: Sequence[Cause]) -> tuple[str, str]:
    """The dependence, and the size of each power; `causes`: the powers of one polynomial, the lowest first."""
    axis, variable = causes[0].slot.polynomial
    return _title(axis, variable, causes), _sizes(diagnosis, variable, causes)


def _title(axis: str, variable: str, causes: Sequence[Cause]) -> str:
    if variable in AXES:
        orders = [_ORDINALS.get(cause.slot.order, f"{cause.slot.order}th") for cause in causes]
        listed = f"{', '.join(orders[:-1])} and {orders[-1]} order"
        response = f"the {axis} axis" if variable == axis else f"output {axis} to input {variable}"
        return f"Nonlinear response of {response}, {listed}"
    return f"The bias of the {axis} axis depends on the {'time' if variable == 'time' else 'temperature'}"


def _sizes(diagnosis: Diagnosis, variable: str, causes: Sequence[Cause]) -> str:
    known = all(len(one.weights) == 1 for cause in causes for one in diagnosis.determined[cause.label])
    orders = [cause.slot.order for cause in causes]
    if variable in AXES or not known or orders != [*range(1, len(causes) + 1)]:
        return "; ".join(words for cause in causes for _, words in size_words(diagnosis, cause))
    references = [_reference(diagnosis, variable, cause) for cause in causes]
    about = "at the first position" if variable == "time" else f"about {references[0]:g} degC"
    return f"{' and '.join(_about(diagnosis, causes, references))} {about}"


def _about(diagnosis: Diagnosis, causes: Sequence[Cause], references: Sequence[float]) -> Iterator[str]:
    """The coefficient of each power, all about the reference of the first: `c (v - r)^p` is the sum over k of
    `c binomial(p, k) (v - s)^k (s - r)^(p - k)`."""
    fit = diagnosis.extended
    for cause in causes:
        order, base = cause.slot.order, cause.slot.units[0]
        weights = {
            other.slot.names[0]: comb(other.slot.order, order)
            * (references[0] - reference) ** (other.slot.order - order)
            for other, reference in zip(causes, references, strict=True)
            if other.slot.order >= order
        }
        places, each = [fit.names.index(name) for name in weights], np.array([*weights.values()])
        sd = float(np.sqrt(each @ fit.covariance[np.ix_(places, places)] @ each))
        unit = display_unit(diagnosis, cause, base)
        value, sd = float(each @ fit.values[places]), with_undetected(diagnosis, weights, sd)
        yield f"{rounded_together(value / factor(unit, base), sd / factor(unit, base))} {unit}"


def _reference(diagnosis: Diagnosis, variable: str, cause: Cause) -> float:
    """Reference of a power: degC, or s since the first position."""
    if variable == "time":
        return 0.0 if cause.slot.order == 1 else float(np.mean(np.asarray(elapsed(diagnosis.problem.where))))
    stated = diagnosis.entries[cause.label].forms[0].get("reference_degc", REFERENCE_DEGC)
    return float(np.mean(np.asarray(diagnosis.data.temperature_degc)) if stated == MEAN else stated)
