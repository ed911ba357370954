"""Coefficients of the causes of a diagnosis, in the units in which they are shown."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import comb

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.causes.together import polynomials
from tumblecal.diagnosis.diagnosis import Diagnosis
from tumblecal.effects.effect import MEAN, elapsed
from tumblecal.effects.environment import REFERENCE_DEGC
from tumblecal.estimation.plausibility import implausible_words
from tumblecal.ground.axes import AXES
from tumblecal.ground.units import factor, shown


@dataclass(frozen=True)
class Coefficient:
    """A coefficient of a cause, or a combination of several, in display units.

    - `weights`: of the coefficients by name.
    - `sd`: standard uncertainty, with the part of undetected effects; None if the data do not determine it: then `value` is
      only that of the fit.
    """

    weights: Mapping[str, float]
    value: float
    sd: float | None
    unit: str

    @property
    def determined(self) -> bool:
        """Whether the data determine it."""
        return self.sd is not None


def findings_of_causes(diagnosis: Diagnosis) -> dict[int, tuple[Cause, ...]]:
    """The causes of each finding by its number, the powers of a polynomial together, the lowest first. Errors of the data, of
    their noise and unnamed ones come before."""
    unnamed = diagnosis.unnamed
    first = first_unnamed(diagnosis) + (0 if unnamed is None else 1 if unnamed.law is None else 2)
    # A candidate law states the unnamed error more exactly.
    causes = [cause for cause in diagnosis.members if cause.named or unnamed is None or unnamed.law is None]
    together = {min(numbers): numbers for numbers in polynomials([cause.slot for cause in causes])}
    later = {number for numbers in together.values() for number in numbers} - together.keys()
    findings = [tuple([causes[k] for k in together.get(n, (n,))]) for n in range(len(causes)) if n not in later]
    return dict(enumerate(findings, first))


def first_unnamed(diagnosis: Diagnosis) -> int:
    """Number of the first finding of an unexplained error: implausible values and errors of the data come before."""
    unusual = implausible_words(diagnosis.implausible)
    return 1 + len(unusual) + len({*diagnosis.setup_errors}) + len(diagnosis.noise_wrong)


def coefficients(diagnosis: Diagnosis, cause: Cause) -> list[Coefficient]:
    """Each coefficient of one fitted effect, then the combinations of several that the data determine."""
    fit, determined = diagnosis.extended, [one.weights for one in diagnosis.determined[cause.label]]
    listed = []
    for name in cause.slot.names:
        single = _coefficient(diagnosis, cause, {name: 1.0}, name, fit.covariance)
        alone = any(weights.keys() == {name} for weights in determined)
        listed.append(single if alone else replace(single, sd=None))
    for weights in determined:
        if len(weights) > 1:
            largest = max(weights, key=lambda name: abs(weights[name]))
            listed.append(_coefficient(diagnosis, cause, weights, largest, fit.noise_covariance))
    return listed


def _coefficient(
    diagnosis: Diagnosis,
    cause: Cause,
    weights: Mapping[str, float],
    name: str,
    covariance: Float[np.ndarray, "free free"],
) -> Coefficient:
    """A combination in the unit of one of the cause's coefficients; `covariance`: of the fit."""
    fit, used, each = diagnosis.extended, diagnosis.in_use, np.array([*weights.values()])

    def variance(names: Sequence[str], of_names: np.ndarray) -> float:
        places = [names.index(name) for name in weights]
        return float(each @ of_names[np.ix_(places, places)] @ each)

    squares = variance(fit.names, covariance)
    if weights.keys() <= set(used.names):
        squares += variance(used.names, used.undetected.covariance)
    base, entry = cause.slot.units[cause.slot.names.index(name)], diagnosis.entries[cause.label]
    unit = entry.unit if entry.shows(base) else shown(base)[0]
    value, scale = float(each @ [fit.values[fit.names.index(name)] for name in weights]), factor(unit, base)
    return Coefficient(weights, value / scale, float(np.sqrt(squares)) / scale, unit)


def about_one_reference(diagnosis: Diagnosis, causes: Sequence[Cause]) -> tuple[list[Coefficient], float | None]:
    """The coefficients of a polynomial in time or temperature about one reference, and this reference: degC, or s since the
    first position; [] and None if one of them is not determined, or if the polynomial is in something else.

    `c (v - r)^p` is the sum over k of `c binomial(p, k) (v - s)^k (s - r)^(p - k)`.

    **Arguments:**

    - `causes`: its powers, the lowest first, or one cause that includes them.
    """
    if any(len(one.weights) > 1 for cause in causes for one in diagnosis.determined[cause.label]):
        return [], None
    orders = [cause.slot.order for cause in causes]
    if causes[0].slot.of_several_orders:
        listed = coefficients(diagnosis, causes[0])
        return (listed, REFERENCE_DEGC) if all(one.sd is not None for one in listed) else ([], None)
    if len(orders) < 2 or orders != [*range(1, len(orders) + 1)] or causes[0].slot.polynomial[1] in AXES:
        return [], None
    references = [_reference(diagnosis, cause) for cause in causes]
    listed = []
    for cause in causes:
        weights = {
            other.slot.names[0]: comb(other.slot.order, cause.slot.order)
            * (references[0] - reference) ** (other.slot.order - cause.slot.order)
            for other, reference in zip(causes, references, strict=True)
            if other.slot.order >= cause.slot.order
        }
        listed.append(_coefficient(diagnosis, cause, weights, cause.slot.names[0], diagnosis.extended.covariance))
    return listed, references[0]


def _reference(diagnosis: Diagnosis, cause: Cause) -> float:
    """Reference of a power."""
    if cause.slot.polynomial[1] == "time":
        return 0.0 if cause.slot.order == 1 else float(np.mean(np.asarray(elapsed(diagnosis.problem.where))))
    stated = diagnosis.entries[cause.label].forms[0].get("reference_degc", REFERENCE_DEGC)
    return float(np.mean(np.asarray(diagnosis.data.temperature_degc)) if stated == MEAN else stated)


def temperature_orders(causes: Iterable[Cause]) -> dict[str, int]:
    """The order in which each parameter of the sensor follows the temperature, by its name."""
    orders: dict[str, int] = {}
    for cause in causes:
        if parameter := cause.slot.parameter_over_temperature:
            axis, *powers = parameter
            of_input = AXES[powers.index(1)] if sum(powers) == 1 else ""
            name = {"": f"bias_{axis}", axis: f"dK_{axis}"}.get(of_input)
            if name and sum(powers) <= 1:
                orders[name] = max(orders.get(name, 0), cause.slot.order or len(cause.slot.columns))
    return orders
