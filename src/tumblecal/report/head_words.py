"""Units on one head, or of a hand-held session, in words: common errors, outlying units, and the uncertainty of the errors."""

import math
from collections.abc import Collection, Iterable, Iterator, Sequence

from tumblecal.chain.head_file import PITCH
from tumblecal.diagnosis.causes.cause import label_words
from tumblecal.diagnosis.priors import SURE
from tumblecal.diagnosis.units import JointDiagnosis
from tumblecal.diagnosis.units.search import SharedExplanation
from tumblecal.effects import Catalogue
from tumblecal.estimation.plausibility import implausible_words
from tumblecal.ground.counted import shortened
from tumblecal.ground.numbers_shown import p_words, rounded_together
from tumblecal.report.head_amounts import (
    UnitRows,
    between_units_words,
    level_sizes,
    shared_coefficients,
    shown_in,
    spread_sizes,
)
from tumblecal.show.verdict import Finding, Verdict


ATTITUDES = (
    "No dividing head is involved, and no head.toml is written. Assumed: the attitudes of the units are independent; this is "
    "correct for units on one fixture and for units measured one after the other."
)


def session(found: JointDiagnosis, units: int) -> str:
    """The session as a title."""
    return f"{units} units, hand-held" if found.hand_held else f"{units} units on one head"


_HEADLINES = {
    "adequate": "no error common to the units was found. Errors of individual units, if any, are listed below.",
    "identified": "the head has an error, and {all} show it.",
    "ambiguous": "{all} show an error of the head; {way}.",
    "unexplained": "{all} show an error of the head that no catalogued effect explains.",
}
_MOST_UNITS = 12
_LEAST_LISTED = 0.02


def units_verdict(found: JointDiagnosis, units: UnitRows, entries: Catalogue) -> Verdict:
    """The verdict on the head and the errors of individual units."""
    if found.hand_held:
        return _hand_held_verdict(found, units, entries)
    joint, best = found.joint, found.joint.best
    others = (e.probability for e in joint.explanations if e is not best)
    way = ambiguity(best.probability, others, indistinguishable=not best.shared.single_name)
    chance = probability_words(joint.p_value, joint.detected)
    rest, count = _all_but(found.fit.excluded, units), len(units) - len(found.fit.excluded)
    evidence = [
        *(f"IMPLAUSIBLE: {words}. No head.toml is written." for words in implausible_words(found.implausible)),
        f"Joint test of {count} units for an error of the head: {p_words(joint.p_value)}; {chance}",
    ]
    if best.shared.labels:
        same = "; ".join(label_words(labels) for labels in best.shared.stated[:8])
        of_class = f" for this class of indistinguishable explanations: {same}" if same else ""
        evidence.append(
            f"Shared by {rest}: {label_words(best.shared.labels)} (probability {best.probability:.2f}{of_class})."
        )
    words = [*_shared(found, entries), *_levels(found, units, entries), *_spreads(found, units, entries)]
    return Verdict(
        found.verdict,
        _headline(found, way, rest),
        found=tuple(map(Finding, words)),
        evidence=(*evidence, *_others(joint.explanations, best), *_pitch(found, units)),
        next=tuple(_single_units(found, units)),
    )


def _hand_held_verdict(found: JointDiagnosis, units: UnitRows, entries: Catalogue) -> Verdict:
    """The effects that the units have in common, and the causes of single units. Without a dividing head only effects of the
    sensors can be common to them."""
    words, common = [], spread_sizes(found, entries)
    for id, sizes in common.items():
        count = len(shown_in(found)[id])
        listed = "; ".join(between_units_words(name, size) for name, size in sizes.items())
        words.append(f"{id} ({listed}), significant in {count} of {len(units)} units alone. {entries[id].cause}")
    alone = [f"{name}: {row['causes']} ({row['probability']:.2f})" for name, row in units if row.get("causes")]
    if common:
        headline = f"the {len(units)} units have in common {', '.join(common)}, with different coefficients."
    elif alone:
        headline = f"no effect is common to the {len(units)} units; {len(alone)} of them have individual causes."
    else:
        headline = f"the {len(units)} units have no effect in common, and all are consistent with the nominal model."
    evidence = (ATTITUDES, *([f"Causes of individual units: {'; '.join(alone)}."] if alone else []))
    return Verdict(found.verdict, headline, found=tuple(map(Finding, words)), evidence=evidence)


def units_text(found: JointDiagnosis, units: UnitRows, entries: Catalogue) -> str:
    """The verdict on units without layout, a paragraph a line."""
    verdict = units_verdict(found, units, entries)
    head = f"{verdict.verdict.upper()}: {verdict.headline}"
    return "\n".join([head, *(f"- {one.words}" for one in verdict.found), *verdict.evidence, *verdict.next])


def _headline(found: JointDiagnosis, way: str, rest: str) -> str:
    if found.implausible:
        return "the units share an error that is too large for a head; check the set-up first."
    differing = [levels.signal.label for levels in found.levels] or found.joint.best.head_by_unit
    if found.verdict == "adequate" or found.joint.best.shared.labels or not differing:
        return _HEADLINES[found.verdict].format(way=way, all=rest)
    how = "changes from some unit on" if found.levels else "differs between units"
    reservation = "" if found.verdict == "identified" else "; this is not conclusive"
    return f"the head is not the same for all units: {', '.join(differing)} {how}{reservation}."


def _all_but(left_out: Collection[int], units: UnitRows) -> str:
    """All units, except those of some numbers."""
    names = [units[k][0] for k in sorted(left_out)]
    return f"all units except {shortened(names, _MOST_UNITS)}" if names else "all units"


def _shared(found: JointDiagnosis, entries: Catalogue) -> Iterator[str]:
    coefficients = shared_coefficients(found, entries)
    for signal in found.shared:
        sizes = "; ".join(f"{name} = {_with_u(coefficients[name])}" for name in signal.slot.names)
        yield f"{sizes}. {entries[signal.label].cause} {entries[signal.label].advice}"
    for words in found.unexplained:
        yield f"an effect that is not in the catalogue; it depends on {words}"


def _levels(found: JointDiagnosis, units: UnitRows, entries: Catalogue) -> Iterator[str]:
    for levels in level_sizes(found, entries):
        before, after = ([units[k][0] for k in (part["first"], part["last"])] for part in levels["parts"])
        listed = []
        for (first, last), part in zip((before, after), levels["parts"], strict=True):
            sizes = ", ".join(f"{name} = {_with_u(size)}" for name, size in part["coefficients"].items())
            listed.append(f"{first} to {last} {sizes or 'not determined separately'}")
        changed = "re-levelled or set up again" if levels["effect"] == "base_levelling" else "set up again"
        yield (
            f"{levels['effect']}: two levels, {'; '.join(listed)} ({p_words(levels['p_value'])} for units in any order). The "
            f"head was {changed} between {before[1]} and {after[0]}. Run --units separately for each part."
        )


def _spreads(found: JointDiagnosis, units: UnitRows, entries: Catalogue) -> Iterator[str]:
    in_order, shown = {levels.signal.label for levels in found.levels}, shown_in(found)
    for id, sizes in spread_sizes(found, entries).items():
        if id in in_order:
            continue
        listed = "; ".join(between_units_words(name, size) for name, size in sizes.items())
        part = ", or a part of the unnamed effect" if found.unexplained else ""
        yield f"{id}: {_where(shown[id], units)}; not a constant error of the head{part} ({listed}). {entries[id].cause}"


def _where(shown: Sequence[int], units: UnitRows) -> str:
    """The units that show an effect whose size differs between units."""
    if len(shown) == len(units):
        return "in all units, with a different size in each"
    if not shown:
        return "in the units together, but not clearly in any single one"
    more = ", ..." if len(shown) > _MOST_UNITS else ""
    names = ", ".join(units[k][0] for k in shown[:_MOST_UNITS])
    return f"in {len(shown)} of {len(units)} units ({names}{more}), with a different size in each"


def _with_u(size: dict) -> str:
    return f"{rounded_together(size['value'], size['sd'])} {size['unit']}"


def _others(explanations: Sequence[SharedExplanation], best: SharedExplanation) -> Iterator[str]:
    others = [one for one in explanations if one is not best and one.probability > _LEAST_LISTED][:4]
    if others:
        yield f"Other explanations: {'; '.join(f'{explanation_words(one)} {one.probability:.2f}' for one in others)}."


def explanation_words(explanation: SharedExplanation) -> str:
    """The effects that the units share, and those that differ between units."""
    shared = label_words(explanation.shared.labels) or "nothing shared"
    return shared + (f" ({', '.join(explanation.by_unit)} by unit)" if explanation.by_unit else "")


def _pitch(found: JointDiagnosis, units: UnitRows) -> Iterator[str]:
    fit = found.fit
    if fit.pitch.p_value is None:
        return
    if fit.pitch.common:
        assert fit.head is not None
        sizes = "; ".join(
            f"{name} = {rounded_together(value * 1e3, sd * 1e3)} mrad"
            for name, value, sd in zip(fit.head.names, fit.head.values, fit.head.sd, strict=True)
            if name.startswith(PITCH)
        )
        rest = _all_but({*fit.excluded, *fit.pitch.alone}, units)
        chance = p_words(fit.pitch.p_value)
        yield f"Pitch settings: their errors are equal in {rest} ({chance}) and belong to the head: {sizes}."
        if fit.pitch.alone:
            others = ", ".join(units[k][0] for k in fit.pitch.alone)
            yield f"Pitch labels or settings of {others} differ; check these units separately."
    elif fit.pitch.changed is not None:
        last, first = units[fit.pitch.changed - 1][0], units[fit.pitch.changed][0]
        yield (
            f"Pitch settings: their errors are equal up to {last}, and equal with other values from {first} on (test of one "
            f"value for all: {p_words(fit.pitch.p_value)}). The axis was set up again between them. Run --units separately "
            "for each part."
        )
    else:
        yield (
            f"Pitch settings: their errors differ between units ({p_words(fit.pitch.p_value)}). They were set again for each "
            "unit and do not belong to the head."
        )


def _single_units(found: JointDiagnosis, units: UnitRows) -> Iterator[str]:
    in_levels = {levels.signal.label for levels in found.levels}
    rows = [(k, name, row) for k, (name, row) in enumerate(units) if row.get("causes")]
    single = [
        f"{name}: {row['causes']} ({row['probability']:.2f})"
        for k, name, row in rows
        if k not in found.nothing_of_their_own and not in_levels >= {*row["causes"].split(" + ")}
    ]
    same = [name for k, name, _ in rows if k in found.nothing_of_their_own]
    if same:
        show = "shows" if len(same) == 1 else "show"
        yield f"Diagnosed separately, {shortened(same, _MOST_UNITS)} {show} the same error of the head, whatever its name."
    if single:
        yield f"Errors of individual units: {shortened(single, _MOST_UNITS, '; ', '; and')}."
    outlying = [units[k][0] for k in found.outlying]
    if outlying:
        excluded = " They are excluded from the results of the head." if found.fit.excluded else ""
        yield (
            "Outlying units, without the common error, with a different size of it, or with different pitch settings: "
            f"{', '.join(outlying)}.{excluded} Check them separately, the angles in their files first."
        )


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
