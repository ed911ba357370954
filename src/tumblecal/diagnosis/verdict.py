"""The verdict in plain words: what is wrong, how sure, what to do, what was gained, what cannot be said."""

import math
from collections.abc import Iterator

from tumblecal.chain.units import factor, in_words, shown
from tumblecal.diagnosis.candidates import Candidate
from tumblecal.diagnosis.diagnose import Diagnosis
from tumblecal.diagnosis.explanations import UNEXPLAINED
from tumblecal.diagnosis.next_positions import SEPARATE, NextPlan, NextPosition
from tumblecal.estimation.mountings import mounting_words


_HEADLINES = {
    "adequate": "ADEQUATE: nothing in these data contradicts the model.",
    "identified": "IDENTIFIED: the model is wrong, and the data say why.",
    "ambiguous": "AMBIGUOUS: the model is wrong; several causes explain it about equally well.",
    "unexplained": "UNEXPLAINED: the model is wrong, and no effect of the catalogue explains it.",
}


# Said where the noise of the raw samples is not enough.
_BESIDE_SAMPLES = (
    "The raw samples do not show this: it is slower than a dwell, or comes from setting the positions (a head that does not "
    "repeat, handling)."
)


def verdict_text(found: Diagnosis) -> str:
    """The verdict and its reasons, a paragraph a line."""
    return "\n".join([_headline(found), *_reasons(found), *_cannot_say(found), *_next(found)])


def _headline(found: Diagnosis) -> str:
    if found.best.labels or not (found.mix_ups or found.noise_labels):
        return _HEADLINES[found.verdict]
    faults = {
        "the readings are not what their columns say": found.mix_ups,
        "the noise is not as assumed": found.noise_labels,
    }
    wrong = " and ".join(words for words, there in faults.items() if there)
    return f"{found.verdict.upper()}: {wrong}; otherwise nothing contradicts the model."


def _reasons(found: Diagnosis) -> Iterator[str]:
    test = found.screened.detection
    noise = "stated noise" if found.how.known else "noise estimated from the data"
    if found.samples is not None:
        noise = f"noise of {found.samples.origin}" + ("" if found.how.known else ", its level estimated from the data")
    chance = probability_words(test.p_value, test.detected)
    before = f" (under the noise as assumed: {p_words(found.assumed_p_value)})" if found.noise_labels else ""
    yield f"Test over the whole list of causes, {noise}: {p_words(test.p_value)}{before}; {chance}"
    if found.samples is not None:
        ratio = found.extended.sigma
        scatter = f" The positions scatter {ratio:.2g} times as much as that sd." if found.samples.extrapolated else ""
        yield found.samples.words() + scatter
    for one in found.mix_ups:
        advice = found.entries[one.label].advice
        yield f"- {one.label}: {one.words}. {advice} The diagnosis goes on with the readings put right."
    yield from filter(None, [mounting_words(found.mountings)])
    for label, words in found.noise_found.items():
        yield (
            f"- {label}: {found.entries[label].cause} Found: {words}. All tests and intervals here are made "
            f"with the corrected weights. {found.entries[label].advice}"
        )
    if found.samples is not None and found.noise_labels:
        yield _BESIDE_SAMPLES
    if not found.best.labels:
        size, dof = found.nominal.rms * 1e3, found.nominal.dof
        yield f"Residuals: {size:.3g} mg rms with {found.model.nominal} parameters, {dof} degrees of freedom."
        return
    sure = f"probability {found.best.probability:.2f}{_with_equivalents(found)}"
    yield f"Best explanation: {label_words(found.best.labels)} ({sure})."
    for one in found.members:
        yield f"- {member_words(found, one)}"
    yield from _rivals(found)
    yield from _gained(found)


def _with_equivalents(found: Diagnosis) -> str:
    return " together with those that these data cannot tell from it" if found.best.equivalents else ""


def member_words(found: Diagnosis, one: Candidate) -> str:
    """One cause with its coefficients or position, and the advice."""
    if one.family == "generic":
        return f"something that depends like {one.words}; no entry of the catalogue describes it"
    entry = found.entries[one.id]
    if one.slot is None:
        where = one.label.partition(":")[2] + (f" ({one.words})" if one.words else "")
        return f"{one.id} at {where}: {entry.cause} {entry.advice}"
    sizes = "; ".join(
        f"{name} = {value['value']:.3g} +- {value['sd']:.2g} {value['unit']}"
        for name, value in coefficients(found, one).items()
    )
    return f"{sizes}. {entry.cause} {entry.advice}"


def coefficients(found: Diagnosis, one: Candidate) -> dict[str, dict]:
    """Coefficients of one fitted effect: value, sd and unit as shown."""
    if one.slot is None:
        return {}
    sd = found.extended.vector_sd(found.model)
    unit = found.entries[one.id].unit
    listed = {}
    columns = sorted((*one.slot.columns, *one.slot.shape))
    for name, base, column in zip(one.slot.names, one.slot.units, columns, strict=True):
        display = "min" if base == "s" else unit
        scale = factor(display, base)
        listed[name] = {
            "value": float(found.extended.vector[column] / scale),
            "sd": float(sd[column] / scale),
            "unit": display,
        }
    return listed


def label_words(labels: tuple[str, ...]) -> str:
    """`a + b at 1-3`."""
    return " + ".join(label.replace(":", " at ") for label in labels)


def _rivals(found: Diagnosis) -> Iterator[str]:
    if found.best.equivalents:
        same = "; ".join(label_words(labels) for labels in found.best.equivalents[:8])
        yield f"These data cannot tell it from: {same}."
    others = [one for one in found.screened.explanations if one is not found.best and one.probability > 0.02][:4]
    if others:
        listed = "; ".join(f"{label_words(one.labels) or 'adequate'} {one.probability:.2f}" for one in others)
        yield f"Other explanations: {listed}."


def _gained(found: Diagnosis) -> Iterator[str]:
    gain = found.gain
    anew = ""
    if gain.cv_same_causes is not None:
        anew = f", causes sought anew each time and the same in {100 * gain.cv_same_causes:.0f} %"
    slow = "" if found.how.whiten is None else " (with what neighbouring positions share)"
    yield (
        f"Residuals {gain.rms_before_g * 1e3:.3g} -> {gain.rms_after_g * 1e3:.3g} mg rms{slow}; predictions of data that took "
        f"no part ({gain.cv_kind}{anew}) {gain.cv_rms_before_g * 1e3:.3g} -> {gain.cv_rms_after_g * 1e3:.3g} mg "
        f"(gain +- {short(gain.cv_gain_sd_g * 1e3)}); expected of a new measurement {gain.fresh_rms_before_g * 1e3:.3g} -> "
        f"{gain.fresh_rms_after_g * 1e3:.3g} mg (+- {short(gain.fresh_gain_sd_g * 1e3)}); delta BIC "
        f"{bic_words(gain.delta_bic)}."
    )
    moved = sorted(shifts(found).items(), key=lambda item: -abs(item[1]["in_sd"]))
    sizes = [(name, in_words(f"{value['shift']:.3g}", value["unit"]), value["in_sd"]) for name, value in moved[:3]]
    worst = [f"{name} by {size} ({in_sd:+.1f} sd)" for name, size, in_sd in sizes]
    if moved and abs(moved[0][1]["in_sd"]) > 1.0:
        yield f"The calibration moved: {', '.join(worst)}."
    else:
        yield "No sensor parameter moved by more than its standard deviation."
    outside = [check.name for check in found.checks_after if check.outside]
    if outside:
        yield f"After it, still not as the model would make them: {', '.join(outside)}."


def shifts(found: Diagnosis) -> dict[str, dict]:
    """How far each nominal parameter moved from the nominal to the extended fit, as shown and in its sd."""
    sd = found.extended.vector_sd(found.model)[: found.model.nominal]
    moved = (found.extended.vector - found.nominal.vector)[: found.model.nominal]
    listed = {}
    for k, name in enumerate(found.model.names):
        unit, scale = shown(found.model.units[k])
        listed[name] = {
            "shift": float(moved[k] * scale),
            "unit": unit,
            "in_sd": float(moved[k] / sd[k]) if sd[k] > 0 else 0.0,
        }
    return listed


def _cannot_say(found: Diagnosis) -> Iterator[str]:
    if found.invisible:
        worst = sorted(
            (
                (max(abs(h["in_sd"]) for h in one.harm.values()), id, one)
                for id, one in found.invisible.items()
                if one.harm
            ),
            key=lambda item: -item[0],
        )[:3]
        listed = "; ".join(
            f"{id} ({in_words(one.size, one.unit)} would move {one.absorbed_by[0]} by {size:.1f} sd)"
            for size, id, one in worst
        )
        count = len(found.invisible)
        yield f"These positions cannot show {count} effects at all or in part, however large; the worst: {listed}."
    if found.model.not_testable:
        listed = "; ".join(f"{id} ({reason})" for id, reason in list(found.model.not_testable.items())[:4])
        more = len(found.model.not_testable) - 4
        yield f"Not testable: {listed}{f'; and {more} more' if more > 0 else ''}."


def _next(found: Diagnosis) -> Iterator[str]:
    plan = found.next_plan
    if plan.together:
        yield f"Measure next, to {plan.purpose}: {'; '.join(_grouped(plan.together))}. {_promise(plan)}"
    yield from plan.notes


def _grouped(chosen: tuple[NextPosition, ...]) -> Iterator[str]:
    """Positions in words, those of one mounting and pitch setting together."""
    together: dict[tuple[str, float], list[float]] = {}
    for one in chosen:
        together.setdefault((one.mount, one.beta_deg), []).extend(one.turn_deg or (one.alpha_deg,))
    for (mount, beta), alphas in together.items():
        listed = ", ".join(f"{alpha:g}" for alpha in alphas)
        yield f"alpha {listed} at beta {beta:g}{f' with the triad {mount}' if mount else ''}"


def _promise(plan: NextPlan) -> str:
    if plan.purpose == SEPARATE:
        # Beyond e^20 a number says nothing.
        return (
            f"Expected: the odds of the other explanations fall by a factor of {math.exp(min(plan.value, 20.0)):.2g}."
        )
    return f"Expected: the sd of the worst parameter ({plan.watched} now) falls by {100 * plan.value:.0f} %."


def p_words(p_value: float) -> str:
    """`p = 0.03`; what is too small to be told from zero as a bound."""
    return f"p = {p_value:.2g}" if p_value > 1e-100 else "p below 1e-100"


def bic_words(delta: float) -> str:
    """A difference of BIC, by a decimal as long as that is short."""
    return f"{delta:.1f}" if abs(delta) < 1e5 else f"{delta:.3g}"


def short(value: float) -> str:
    """One significant digit, without a power of ten where there need be none."""
    return f"{float(f'{value:.1g}'):g}"


def probability_words(p_value: float, detected: bool) -> str:
    """A p-value in words."""
    if not detected and p_value < 0.05:
        return "somewhat unusual, but short of what would be called a contradiction."
    if not detected or p_value > 0.01:
        return "as expected when nothing is wrong."
    if p_value < 1e-6:
        return "data of a right model do not look like this."
    return f"a right model gives such data less often than once in {10 ** math.floor(-math.log10(p_value)):,.0f} measurements."


def unexplained_words(found: Diagnosis) -> str:
    """What the unexplained part depends on, in words; empty when there is none."""
    terms = [one.words for one in found.members if one.label == UNEXPLAINED]
    return "; ".join(terms)
