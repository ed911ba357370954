"""Causes in words: their names, what is known of their coefficients, what they are and what to do."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby

import numpy as np

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause, family_of
from tumblecal.diagnosis.causes.generic import UNEXPLAINED
from tumblecal.diagnosis.sets.classes import Explanation
from tumblecal.diagnosis.sets.exchanges import exchanges
from tumblecal.diagnosis.sets.patchwork import Neighbours, is_patchwork
from tumblecal.estimation.identifiability import formula
from tumblecal.ground.numbers_shown import rounded_together
from tumblecal.ground.units import factor, shown


# A cause that is less probable than this is not listed among those of the same signal.
_LEAST_STATED = 0.02
_UNLISTED = "an effect that is not in the catalogue"


def label_words(labels: tuple[str, ...]) -> str:
    """`a + b at 1-3`; of a family `c.x, .y, .z`."""
    families = [list(own) for _, own in groupby(labels, key=lambda label: (family_of(label) or (label,))[0])]
    told = (", ".join([own[0], *("." + label.rpartition(".")[2] for label in own[1:])]) for own in families)
    return " + ".join(words.replace(":", " at ", 1) for words in told)


def identical_words(best: Explanation) -> Iterator[str]:
    """Which causes are one function at 1 g with those named, where there are any: a footnote, as it changes nothing at 1 g."""
    for exchange in exchanges(best.labels, best.identical, best.identical):
        named, other = (label_words(tuple(sorted(own))) for own in (exchange.removed, exchange.added))
        yield (
            f"{named} and {other} are the same function in a 1 g field (u_x^2 + u_y^2 + u_z^2 = 1). No measurement on a head "
            "distinguishes them; at 1 g the correction is the same."
        )


def less_probable_words(best: Explanation) -> Iterator[str]:
    """Which sets could make the signal too, but are improbable, where any has a probability worth stating."""
    others = sorted((own for own in best.less_probable if own[1] >= _LEAST_STATED), key=lambda own: -own[1])
    if others:
        words = ((label_words(own) if own != (UNEXPLAINED,) else _UNLISTED, share) for own, share in others)
        listed = "; ".join(f"{own} (probability {share:.2f})" for own, share in words)
        yield f"less probable causes of the same signal: {listed}"


def by_family(causes: Iterable[Cause]) -> list[list[Cause]]:
    """Causes that differ in their axis alone together, each other one by itself."""
    together: dict[str | int, list[Cause]] = {}
    for number, cause in enumerate(causes):
        family = family_of(cause.label)
        together.setdefault(number if family is None else family[0], []).append(cause)
    return list(together.values())


def other_axes(causes: Sequence[Cause]) -> str:
    """For which axes what is said of the first of a family holds as well; "" where it is alone."""
    others = " and ".join(cause.label.rpartition(".")[2] for cause in causes[1:])
    return f"The same holds for {others}." if others else ""


def size_words(diagnosis: Diagnosis, cause: Cause) -> Iterator[tuple[str, str]]:
    """What is known of the coefficients of one fitted effect: of each by itself, or of which combination alone."""
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
    """Coefficients of one fitted effect: value and unit as shown, sd, and whether the data determine it by itself; where
    they do not, the value is only the one that the model was fitted with, and has no sd."""
    fit, listed = diagnosis.extended, {}
    alone = {next(iter(own.weights)) for own in diagnosis.determined[cause.label] if len(own.weights) == 1}
    for name, base in zip(cause.slot.names, cause.slot.units, strict=True):
        display = display_unit(diagnosis, cause, base)
        scale, k = factor(display, base), fit.names.index(name)
        sd = with_undetected(diagnosis, {name: 1.0}, float(fit.sd[k])) / scale if name in alone else None
        listed[name] = {"value": float(fit.values[k] / scale), "sd": sd, "unit": display, "determined": name in alone}
    return listed


def combined(diagnosis: Diagnosis, cause: Cause) -> list[dict]:
    """The combinations of several coefficients of one fitted effect that the data determine: weights by name, value, sd
    and unit as shown."""
    listed = []
    for own in diagnosis.determined[cause.label]:
        if len(own.weights) > 1:
            base = cause.slot.units[cause.slot.names.index(max(own.weights, key=lambda name: abs(own.weights[name])))]
            display = display_unit(diagnosis, cause, base)
            scale = factor(display, base)
            sd = with_undetected(diagnosis, own.weights, own.sd) / scale
            listed.append({"weights": own.weights, "value": own.value / scale, "sd": sd, "unit": display})
    return listed


def with_undetected(diagnosis: Diagnosis, weights: Mapping[str, float], sd: float) -> float:
    """Standard uncertainty of a combination of coefficients, from that by the noise, with the part of undetected effects."""
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
    """What to think of several jumps, or of positions off beside them: "" where there are none."""
    best, neighbours = diagnosis.best, Neighbours(diagnosis.screened.at)
    if (UNEXPLAINED,) not in best.equivalents:
        return ""
    if neighbours.at_a_jump(best.labels):
        return (
            "An outlier position where the input of a jump is near zero may be no accident: a dead zone, or a jump with the "
            "output instead of the input, reads so there."
        )
    told = is_patchwork(best.labels, len(best.labels), neighbours=neighbours)
    return (
        "So many jumps and single positions at once are more often one effect that no entry describes." if told else ""
    )


def unexplained_words(diagnosis: Diagnosis) -> str:
    """What the unexplained part depends on, in words; empty when there is none."""
    return "; ".join(unexplained_terms(diagnosis))


def unexplained_terms(diagnosis: Diagnosis) -> list[str]:
    """What each unexplained part depends on: a generic term's words, or what lack of fit shows."""
    terms = [member.words for member in diagnosis.members if member.label == UNEXPLAINED]
    if diagnosis.best.unexplained and not terms:
        terms = [diagnosis.screened.unexplained_by_repeats]
    return terms
