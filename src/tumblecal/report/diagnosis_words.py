"""The verdict in plain words: what is wrong, how sure, what to do, what was gained, what cannot be said."""

from collections.abc import Iterator

from tumblecal.data.sensor_parameters import SENSOR, leaf_of
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.generic import UNEXPLAINED
from tumblecal.estimation.mountings import mounting_words
from tumblecal.estimation.plausibility import implausible_words
from tumblecal.ground.numbers_shown import p_words
from tumblecal.ground.units import in_words, shown
from tumblecal.planning.next_plan import NextPlan
from tumblecal.report.cause_words import identical_words, label_words, members_words, patchwork_words, unexplained_words
from tumblecal.report.diagnosis_calibration import diagnosed_use, lacking_of_diagnosis
from tumblecal.report.gravity_words import gravity_warning, gravity_words
from tumblecal.report.identity_words import identity_words
from tumblecal.report.next_plan_words import next_words
from tumblecal.report.number_words import ambiguity, bic_words, odds_words, probability_words, short
from tumblecal.report.sensor_terms import held_words
from tumblecal.report.sentences import as_sentence
from tumblecal.report.setting_words import many_settings_words, read_settings_words
from tumblecal.report.temperature_words import within_dwells_words


_HEADLINES = {
    "adequate": "ADEQUATE: nothing in these data contradicts the model.",
    "identified": "IDENTIFIED: the model is wrong, and the data say why.",
    "unexplained": "UNEXPLAINED: the model is wrong, and no effect of the catalogue explains it.",
}

# A parameter that moved by less than this share of its sd is not listed among those that did.
_MOVED_SD = 0.5

# How well the parameters of the sensor would be known is told from this factor on, of so many of them.
_OF_SENSOR, _MUCH_WIDER, _MOST_UNDETECTED, _MOST_EFFECTS = {leaf_of(name) for name in SENSOR}, 2.0, 3, 2

# Said where the noise of the raw samples is not enough.
_BESIDE_SAMPLES = (
    "The raw samples do not show this: it is slower than a dwell, or comes from setting the positions (a head that does not "
    "repeat, handling)."
)


def verdict_text(diagnosis: Diagnosis, plan: NextPlan | None = None, *, lists: bool = True) -> str:
    """The verdict and its reasons, a paragraph a line; with a plan, what to measure next.

    **Arguments:**

    - `lists`: whether with the effects that the data cannot show; else only how many they are.
    """
    use = f"Use of calibration.json: {diagnosed_use(diagnosis).words}."
    lines = [*_implausible(diagnosis), _headline(diagnosis), use, *_reasons(diagnosis)]
    stated = (identity_words(diagnosis.data), within_dwells_words(diagnosis.data), gravity_words(diagnosis.extended))
    lines += filter(None, stated)
    lines += _cannot_say(diagnosis) if lists else _how_many_cannot_be_seen(diagnosis)
    if plan is not None:
        lines += next_words(plan, label_words(plan.confirming[0].rival) if plan.confirming else "")
    return "\n".join(lines)


def warning_words(diagnosis: Diagnosis) -> Iterator[str]:
    """What a reader of the numbers alone must know: values that no instrument has, what was put right, a gravity that nobody
    stated."""
    if (use := diagnosed_use(diagnosis)).refused:
        yield f"use: {use.words}"
    yield from (f"IMPLAUSIBLE: {words}" for words in implausible_words(diagnosis.implausible))
    yield from (f"put right: {mix_up.label}: {mix_up.told}" for mix_up in diagnosis.mix_ups)
    if gravity := gravity_warning(diagnosis.extended):
        yield gravity
    yield from lacking_of_diagnosis(diagnosis, of_sensor=True)
    if many := many_settings_words(diagnosis.nominal):
        yield many


def _implausible(diagnosis: Diagnosis) -> Iterator[str]:
    if diagnosis.implausible:
        yield (
            "IMPLAUSIBLE: the data contradict what was stated of parameters; look to that before anything else here."
            if _all_stated(diagnosis)
            else "IMPLAUSIBLE: the fit needs parameters far beyond what is usual; look to the set-up before anything else "
            "here. A rig file may state what is usual of yours ([usual])."
        )
        yield from (f"- {words}." for words in implausible_words(diagnosis.implausible))


def _all_stated(diagnosis: Diagnosis) -> bool:
    """Whether nothing is implausible but what was stated."""
    return all(unusual.stated is not None for unusual in diagnosis.implausible)


def _headline(diagnosis: Diagnosis) -> str:
    if diagnosis.implausible and not diagnosis.best.labels:
        if _all_stated(diagnosis):
            return "UNEXPLAINED: without these stated values the data are consistent with the nominal model."
        return "UNEXPLAINED: the nominal model fits these data only with the implausible values above."
    if diagnosis.best.labels or not (diagnosis.mix_ups or diagnosis.noise_labels):
        if diagnosis.verdict == "ambiguous":
            best = diagnosis.best
            others = (e.probability for e in diagnosis.screened.explanations if e is not best)
            way = ambiguity(best.probability, others, alike=not best.single_name)
            return f"AMBIGUOUS: the model is wrong; {way}."
        if diagnosis.verdict == "unexplained" and diagnosis.located:
            return "UNEXPLAINED: the model is wrong, and no effect of the catalogue explains it by acting on all positions."
        return _HEADLINES[diagnosis.verdict]
    faults = {
        "the data are not what their columns say": diagnosis.mix_ups,
        "the noise is not as assumed": diagnosis.noise_labels,
    }
    wrong = " and ".join(words for words, there in faults.items() if there)
    if diagnosis.verdict == "ambiguous":
        wrong += ", or something that no entry describes is there"
    return f"{diagnosis.verdict.upper()}: {wrong}; otherwise nothing contradicts the model."


def _reasons(diagnosis: Diagnosis) -> Iterator[str]:
    test = diagnosis.screened.detection
    noise = "stated noise" if diagnosis.problem.known else "noise estimated from the data"
    if diagnosis.samples is not None:
        noise = f"noise of {diagnosis.samples.origin}" + (
            "" if diagnosis.problem.known else ", its level estimated from the data"
        )
    chance = probability_words(test.p_value, test.detected)
    if diagnosis.implausible and not test.detected:
        # The test is made with the fitted values, so it says nothing for them.
        chance = (
            "given the values above, the residuals are consistent with the noise; this does not confirm these values."
        )
    before = f" (under the noise as assumed: {p_words(diagnosis.assumed_p_value)})" if diagnosis.noise_labels else ""
    yield f"Test over the whole list of causes, {noise}: {p_words(test.p_value)}{before}; {chance}"
    if diagnosis.samples is not None:
        ratio = diagnosis.extended.level
        scatter = (
            f" The positions scatter {ratio:.2g} times as much as that sd." if diagnosis.samples.extrapolated else ""
        )
        yield diagnosis.samples.words() + scatter
    for mix_up in diagnosis.mix_ups:
        advice = diagnosis.entries[mix_up.label].advice
        yield f"- {mix_up.label}: {mix_up.told}. {advice} The diagnosis goes on with the data put right."
    yield from filter(None, [mounting_words(diagnosis.mountings)])
    settings = (read_settings_words(diagnosis.nominal), many_settings_words(diagnosis.nominal))
    given = held_words(diagnosis.extended, diagnosis.model.nominal_chain, diagnosis.entries)
    given = [*given, *lacking_of_diagnosis(diagnosis)]
    yield from (as_sentence(words) for words in (*settings, *(f"{words}." for words in given)) if words)
    for label, fault in diagnosis.noise_wrong.items():
        yield (
            f"- {label}: {diagnosis.entries[label].cause} Found: {fault.words}. All tests and intervals here are made "
            f"with the corrected weights. {diagnosis.entries[label].advice}"
        )
    if diagnosis.samples is not None and diagnosis.noise_labels:
        yield _BESIDE_SAMPLES
    if not diagnosis.best.labels:
        size, dof = diagnosis.nominal.rms * 1e3, diagnosis.nominal.dof
        yield f"Residuals: {size:.3g} mg rms with {diagnosis.model.nominal} parameters, {dof} degrees of freedom."
        return
    sure = f"probability {diagnosis.best.probability:.2f}{_with_equivalents(diagnosis)}"
    yield f"Best explanation: {label_words(diagnosis.best.labels)} ({sure})."
    yield from (f"- {words}" for words in members_words(diagnosis))
    if diagnosis.best.unexplained and not diagnosis.members:
        yield f"- something that depends on {unexplained_words(diagnosis)}. No entry of the catalogue describes it."
    if diagnosis.screened.contradicted:
        yield "Its probability is of the linear screen; fitted exactly this set leaves far more: it does not explain the data."
    yield from _rivals(diagnosis)
    if diagnosis.located:
        listed = "; ".join(f"{told.words}, odds {odds_words(told.log_odds)}" for told in diagnosis.located)
        acts = (
            "something without a name"
            if diagnosis.best.labels == (UNEXPLAINED,)
            else "this set, which acts on all positions"
        )
        yield f"More probable than {acts}: {listed}. Look at what is different there."
    yield from _gained(diagnosis)


def _with_equivalents(diagnosis: Diagnosis) -> str:
    return " together with those that these data cannot tell from it" if diagnosis.best.separable else ""


def _rivals(diagnosis: Diagnosis) -> Iterator[str]:
    yield from identical_words(diagnosis.best)
    if diagnosis.best.separable:
        same = "; ".join(label_words(labels) for labels in diagnosis.best.separable[:8])
        yield f"These data cannot tell it from: {same}. {patchwork_words(diagnosis)}".rstrip()
    others = [e for e in diagnosis.screened.explanations if e is not diagnosis.best and e.probability > 0.02][:4]
    if others:
        listed = "; ".join(f"{label_words(other.labels) or 'adequate'} {other.probability:.2f}" for other in others)
        yield f"Other explanations: {listed}."


def _gained(diagnosis: Diagnosis) -> Iterator[str]:
    gain = diagnosis.gain
    anew = ""
    if gain.cv_same_causes is not None:
        anew = f", causes sought anew each time and the same in {100 * gain.cv_same_causes:.0f} %"
    slow = "" if not diagnosis.problem.correlated else " (with what neighbouring positions share)"
    yield (
        f"Residuals {gain.rms_before_g * 1e3:.3g} -> {gain.rms_after_g * 1e3:.3g} mg rms{slow}; predictions of data that took "
        f"no part ({gain.cv_kind}{anew}) {gain.cv_rms_before_g * 1e3:.3g} -> {gain.cv_rms_after_g * 1e3:.3g} mg "
        f"(gain +- {short(gain.cv_gain_sd_g * 1e3)}); expected of a new measurement {gain.fresh_rms_before_g * 1e3:.3g} -> "
        f"{gain.fresh_rms_after_g * 1e3:.3g} mg (+- {short(gain.fresh_gain_sd_g * 1e3)}); delta BIC "
        f"{bic_words(gain.delta_bic)}."
    )
    moved = sorted(shifts(diagnosis).items(), key=lambda item: -abs(item[1]["in_sd"]))
    sizes = [(name, in_words(f"{value['shift']:.3g}", value["unit"]), value["in_sd"]) for name, value in moved[:3]]
    worst = [f"{name} by {size} ({in_sd:+.1f} sd)" for name, size, in_sd in sizes if abs(in_sd) > _MOVED_SD]
    if gain.cv_rms_after_g > gain.cv_rms_before_g:
        yield (
            "Predictions became WORSE: positions that took no part are not where this explanation puts them. Do not correct "
            "with it what lies beyond or between these positions."
        )
    if moved and abs(moved[0][1]["in_sd"]) > 1.0:
        yield f"The calibration moved: {', '.join(worst)}."
    else:
        yield "No sensor parameter moved by more than its standard deviation."
    yield from filter(None, [undetermined_words(diagnosis)])
    outside = [check.name for check in diagnosis.checks_after if check.outside]
    if outside:
        yield f"After it, still not as the model would make them: {', '.join(outside)}."


def undetermined_words(diagnosis: Diagnosis) -> str:
    """Which nominal parameters an effect that was named leaves open; "" where there are none."""
    fit, listed = diagnosis.extended, shifts(diagnosis)
    left = [name for name in fit.undetermined if name in listed]
    if not left:
        return ""
    return (
        f"Not determined beside that: {', '.join(left)}. What they take up of coefficients that these positions do not show is "
        "assumed to be of the size of what shows, and their standard deviations hold that."
    )


def shifts(diagnosis: Diagnosis) -> dict[str, dict]:
    """How far each nominal parameter moved from the nominal to the extended fit, as shown and in its sd."""
    count = len(diagnosis.nominal.names)
    sd = diagnosis.extended.sd[:count]
    moved = diagnosis.extended.values[:count] - diagnosis.nominal.values
    listed, single, left = {}, diagnosis.model.layout.of_positions, diagnosis.extended.undetermined
    for k, name in enumerate(diagnosis.nominal.names):
        if single[k]:
            continue
        unit, scale = shown(diagnosis.nominal.units[k])
        listed[name] = {
            "shift": float(moved[k] * scale),
            "unit": unit,
            "in_sd": float(moved[k] / sd[k]) if sd[k] > 0 else 0.0,
            "determined": name not in left,
        }
    return listed


def uncertainty_words(diagnosis: Diagnosis) -> Iterator[str]:
    """Contributions to the stated uncertainties in addition to the noise, for the sensor parameters with the largest ones."""
    used = diagnosis.in_use
    parts, undetected = used.parts, used.undetected
    assert undetected is not None  # what is written includes it
    ratio = {
        name: used.sd[k] / parts["noise"][k]
        for k, name in enumerate(used.names)
        if name in diagnosis.model.names and leaf_of(name) in _OF_SENSOR and parts["noise"][k] > 0
    }
    worst = sorted(ratio, key=lambda name: -ratio[name])[:_MOST_UNDETECTED]
    if not worst or ratio[worst[0]] < _MUCH_WIDER:
        return
    listed = []
    for name in worst:
        k = used.names.index(name)
        unit, scale = shown(diagnosis.model.units[diagnosis.model.names.index(name)])
        size, noise = (in_words(f"{sd * scale:.2g}", unit) for sd in (used.sd[k], parts["noise"][k]))
        by = f", mostly by {', '.join(own)}" if (own := undetected.strongest(k, _MOST_EFFECTS)) else ""
        why = by if parts["undetected_effects"][k] > parts["explanations"][k] else ", mostly by the other explanations"
        listed.append(f"{name} {size} (noise alone {noise}{why})")
    yield (
        "The uncertainties include the other explanations, and undetected effects of the size that these data make probable: "
        f"{'; '.join(listed)}."
    )


def _cannot_say(diagnosis: Diagnosis) -> Iterator[str]:
    yield from uncertainty_words(diagnosis)
    if diagnosis.invisible:
        worst = sorted(
            (
                (max(abs(h["in_sd"]) for h in hidden.harm.values()), id, hidden)
                for id, hidden in diagnosis.invisible.items()
                if hidden.harm
            ),
            key=lambda item: -item[0],
        )[:3]
        listed = "; ".join(
            f"{id} ({in_words(hidden.size, hidden.unit)} would move {hidden.absorbed_by[0]} by {size:.1f} sd)"
            for size, id, hidden in worst
        )
        count = len(diagnosis.invisible)
        yield f"These positions cannot show {count} effects at all or in part, however large; the worst: {listed}."
    if diagnosis.model.not_testable:
        listed = "; ".join(f"{id} ({reason})" for id, reason in list(diagnosis.model.not_testable.items())[:4])
        more = len(diagnosis.model.not_testable) - 4
        yield f"Not testable: {listed}{f'; and {more} more' if more > 0 else ''}."


def _how_many_cannot_be_seen(diagnosis: Diagnosis) -> Iterator[str]:
    counts = {
        "cannot be seen at these positions, in whole or in part": len(diagnosis.invisible),
        "cannot be tested with these data": len(diagnosis.model.not_testable),
    }
    said = [f"{count} {words}" for words, count in counts.items() if count]
    if said:
        yield f"Effects of the catalogue: {'; '.join(said)} (below)."
