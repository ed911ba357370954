"""Causes in words: names, values of their coefficients, polynomials in one variable, and odds."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from math import comb
from typing import Any

import numpy as np

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause, family_of
from tumblecal.diagnosis.causes.generic import UNEXPLAINED
from tumblecal.diagnosis.causes.together import polynomials
from tumblecal.diagnosis.priors import SURE
from tumblecal.diagnosis.sets.explanation import Explanation
from tumblecal.diagnosis.sets.patchwork import Neighbours, is_patchwork
from tumblecal.effects.effect import MEAN, elapsed
from tumblecal.effects.environment import REFERENCE_DEGC
from tumblecal.estimation.identifiability import formula
from tumblecal.ground.axes import AXES
from tumblecal.ground.numbers_shown import rounded_together
from tumblecal.ground.units import factor, shown


# A cause that is less probable than this is not listed among those of the same signal.
_LEAST_STATED = 0.02
_UNLISTED = "an effect that is not in the catalogue"


def label_words(labels: tuple[str, ...]) -> str:
    """`a + b at 1-3`; of a family `c.x, .y, .z`."""
    families = [list(family) for _, family in groupby(labels, key=lambda label: (family_of(label) or (label,))[0])]
    words = (", ".join([first, *("." + label.rpartition(".")[2] for label in others)]) for first, *others in families)
    return " + ".join(name.replace(":", " at ", 1) for name in words)


def less_probable_words(best: Explanation) -> Iterator[str]:
    """Sets that could produce the same signal but are improbable, if any has a probability worth stating."""
    others = sorted((one for one in best.less_probable if one[1] >= _LEAST_STATED), key=lambda one: -one[1])
    if others:
        words = ((label_words(labels) if labels != (UNEXPLAINED,) else _UNLISTED, share) for labels, share in others)
        listed = "; ".join(f"{name} (probability {share:.2f})" for name, share in words)
        yield f"less probable causes of the same signal: {listed}"


def size_words(diagnosis: Diagnosis, cause: Cause) -> Iterator[tuple[str, str]]:
    """Coefficients of one fitted effect that the data determine, separately or as combinations."""
    together = combined(diagnosis, cause)
    for name, value in coefficients(diagnosis, cause).items():
        if value["determined"]:
            yield "coefficient", f"{name} = {rounded_together(value['value'], value['sd'])} {value['unit']}"
        elif not any(name in combination["weights"] for combination in together):
            yield "not determined", f"{name} is not determined ({value['value']:.3g} {value['unit']} in the fit)"
    for combination in together:
        sum_of, size = formula(combination["weights"]), rounded_together(combination["value"], combination["sd"])
        yield "combination", f"only the combination {sum_of} = {size} {combination['unit']} is determined"


def coefficients(diagnosis: Diagnosis, cause: Cause) -> dict[str, dict[str, Any]]:
    """Coefficients of one fitted effect: value, unit and standard uncertainty (`sd`) in display units, and whether the data
    determine it separately. If not, the value is only that of the fit, without an uncertainty."""
    fit, listed = diagnosis.extended, {}
    single = (one for one in diagnosis.determined[cause.label] if len(one.weights) == 1)
    alone = {next(iter(one.weights)) for one in single}
    for name, base in zip(cause.slot.names, cause.slot.units, strict=True):
        display = display_unit(diagnosis, cause, base)
        scale, k = factor(display, base), fit.names.index(name)
        sd = with_undetected(diagnosis, {name: 1.0}, float(fit.sd[k])) / scale if name in alone else None
        listed[name] = {"value": float(fit.values[k] / scale), "sd": sd, "unit": display, "determined": name in alone}
    return listed


def combined(diagnosis: Diagnosis, cause: Cause) -> list[dict[str, Any]]:
    """Combinations of several coefficients of one fitted effect that the data determine: weights by name, value, standard
    uncertainty (`sd`) and display unit."""
    listed = []
    for one in diagnosis.determined[cause.label]:
        if len(one.weights) > 1:
            largest = max(one.weights, key=lambda name: abs(one.weights[name]))
            base = cause.slot.units[cause.slot.names.index(largest)]
            display = display_unit(diagnosis, cause, base)
            scale = factor(display, base)
            sd = with_undetected(diagnosis, one.weights, one.sd) / scale
            listed.append({"weights": one.weights, "value": one.value / scale, "sd": sd, "unit": display})
    return listed


def with_undetected(diagnosis: Diagnosis, weights: Mapping[str, float], sd: float) -> float:
    """Standard uncertainty of a combination of coefficients: that of the noise, with the part of undetected effects."""
    used = diagnosis.in_use
    if not weights.keys() <= set(used.names):
        return sd
    places, each = [used.names.index(name) for name in weights], np.array(list(weights.values()))
    return float(np.sqrt(sd**2 + each @ used.undetected.covariance[np.ix_(places, places)] @ each))


def display_unit(diagnosis: Diagnosis, cause: Cause, base: str) -> str:
    """The unit in which a coefficient of a base unit is shown."""
    entry = diagnosis.entries[cause.label]
    return entry.unit if entry.shows(base) else shown(base)[0]


def patchwork_words(diagnosis: Diagnosis) -> str:
    """A reservation about several jumps and outlier positions that may imitate an unnamed effect; "" if there are none."""
    best, neighbours = diagnosis.best, Neighbours(diagnosis.screened.at)
    if (UNEXPLAINED,) not in best.equivalents:
        return ""
    if neighbours.at_a_jump(best.labels):
        return (
            "The outlier position is close to zero input of a jump. A dead zone, or a jump that follows the output instead of "
            "the input, gives the same reading."
        )
    imitates = is_patchwork(best.labels, neighbours=neighbours)
    return (
        "Several jumps and outlier positions together usually imitate one effect without an entry." if imitates else ""
    )


def unexplained_words(diagnosis: Diagnosis) -> str:
    """The variables that the unexplained part depends on, in words; "" if there is none."""
    return "; ".join(unexplained_terms(diagnosis))


def unexplained_terms(diagnosis: Diagnosis) -> list[str]:
    """The dependence of each unexplained part: words of a generic term, or the result of the lack-of-fit test."""
    terms = [member.words for member in diagnosis.members if member.label == UNEXPLAINED]
    if diagnosis.best.unexplained and not terms:
        terms = [diagnosis.screened.unexplained_by_repeats]
    return terms


# An explanation that is this many times as probable as the next is the more probable one.
_AHEAD = 2.0


def probability_words(p_value: float, detected: bool) -> str:
    """A p-value in words."""
    if not detected and p_value < 0.05:
        return "unusual, but the nominal model is not rejected."
    if not detected or p_value > 0.01:
        return "consistent with the nominal model."
    if p_value < 1e-6:
        return "the nominal model is rejected."
    return (
        "the nominal model is rejected; a correct model would produce such data in fewer than 1 of "
        f"{10 ** math.floor(-math.log10(p_value)):,.0f} measurements."
    )


def ambiguity(probability: float, others: Iterable[float], *, indistinguishable: bool) -> str:
    """The kind of an ambiguity between several causes.

    `probability`: of the leading explanation, `others`: of the rest. `indistinguishable`: whether some produce the same signal.
    """
    if indistinguishable and probability >= SURE:
        return "several causes fit equally well and cannot be distinguished with these positions"
    if probability > _AHEAD * max(others, default=0.0):
        return "one explanation is more probable than the others, but not conclusive"
    return "several causes explain it almost equally well"


def odds_words(log_odds: float) -> str:
    """`20 to 1`, from the logarithm of the odds."""
    return f"{math.exp(log_odds):.0f} to 1" if log_odds < math.log(1000) else "more than 1000 to 1"


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


def order_sizes(diagnosis: Diagnosis, cause: Cause) -> str:
    """The coefficients of an effect of several orders of the temperature: `a mg/degC and b ug/degC^2 about 25 degC`."""
    words = [size for _, size in size_words(diagnosis, cause)]
    if combined(diagnosis, cause) or not all(one["determined"] for one in coefficients(diagnosis, cause).values()):
        return "; ".join(words)
    *lower, highest = (size.partition(" = ")[2] for size in words)
    return f"{', '.join(lower)} and {highest} about {REFERENCE_DEGC:g} degC"


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
