"""Causes in words: their names, and the values of their coefficients."""

from collections.abc import Iterator, Mapping
from itertools import groupby

import numpy as np

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause, family_of
from tumblecal.diagnosis.causes.generic import UNEXPLAINED
from tumblecal.diagnosis.sets.classes import Explanation
from tumblecal.diagnosis.sets.patchwork import Neighbours, is_patchwork
from tumblecal.estimation.identifiability import formula
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


def coefficients(diagnosis: Diagnosis, cause: Cause) -> dict[str, dict]:
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


def combined(diagnosis: Diagnosis, cause: Cause) -> list[dict]:
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
    if used.undetected is None or not weights.keys() <= set(used.names):
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
    imitates = is_patchwork(best.labels, len(best.labels), neighbours=neighbours)
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
