"""What units on one head say together, in words: what they share, which stand out, how well the head is known now."""

from collections.abc import Collection, Iterator, Sequence

import numpy as np

from tumblecal.chain.head_file import PITCH
from tumblecal.diagnosis.head import Together
from tumblecal.diagnosis.head.joint import SharedExplanation
from tumblecal.effects import Catalogue
from tumblecal.effects.catalogue import belongs_to
from tumblecal.estimation.plausibility import implausible_words
from tumblecal.ground.numbers_shown import p_words
from tumblecal.ground.units import factor, shown
from tumblecal.report.cause_words import label_words
from tumblecal.report.hand_held_units import hand_held_verdict
from tumblecal.report.head_amounts import UnitRows, level_sizes, shown_in, spread_sizes
from tumblecal.report.number_words import ambiguity, probability_words
from tumblecal.report.verdict import Finding, Verdict


_HEADLINES = {
    "adequate": "no error common to the units was found. Errors of individual units, if any, are listed below.",
    "identified": "the head has an error, and {all} show it.",
    "ambiguous": "{all} show an error of the head; {way}.",
    "unexplained": "{all} show an error of the head that no effect of the catalogue explains.",
}
_MOST_UNITS = 12
_LEAST_TOLD = 0.02


def units_verdict(found: Together, units: UnitRows, entries: Catalogue) -> Verdict:
    """The verdict on the head and the errors of individual units."""
    if found.hand_held:
        return hand_held_verdict(found, units, entries)
    joint, best = found.joint, found.joint.best
    others = (e.probability for e in joint.explanations if e is not best)
    way = ambiguity(best.probability, others, alike=not best.told.single_name)
    chance = probability_words(joint.p_value, joint.detected)
    rest, count = _all_but(found.fit.aside, units), len(units) - len(found.fit.aside)
    evidence = [
        *(f"IMPLAUSIBLE: {words}. No head.toml is written." for words in implausible_words(found.implausible)),
        f"Test of {count} units together, whether the head has an error: {p_words(joint.p_value)}; {chance}",
    ]
    if best.told.labels:
        same = "; ".join(label_words(labels) for labels in best.told.stated[:8])
        beside = f" together with those that these data cannot tell from it: {same}" if same else ""
        evidence.append(
            f"Shared by {rest}: {label_words(best.told.labels)} (probability {best.probability:.2f}{beside})."
        )
    words = [*_shared(found, entries), *_levels(found, units, entries), *_spreads(found, units, entries)]
    return Verdict(
        found.verdict,
        _headline(found, way, rest),
        "",
        "",
        found=tuple(map(Finding, words)),
        evidence=(*evidence, *_others(joint.explanations, best), *_pitch(found, units)),
        next=tuple(_own(found, units)),
    )


def units_text(found: Together, units: UnitRows, entries: Catalogue) -> str:
    """The verdict on units without layout, a paragraph a line."""
    verdict = units_verdict(found, units, entries)
    head = f"{verdict.verdict.upper()}: {verdict.headline}"
    return "\n".join([head, *(f"- {one.words}" for one in verdict.found), *verdict.evidence, *verdict.next])


def _headline(found: Together, way: str, rest: str) -> str:
    if found.implausible:
        return "the units share an error that is too large for a head; check the set-up first."
    differing = [own.signal.label for own in found.levels] or found.joint.best.head_spreads
    if found.verdict == "adequate" or found.joint.best.told.labels or not differing:
        return _HEADLINES[found.verdict].format(way=way, all=rest)
    how = "from some unit on" if found.levels else "in each"
    surely = "" if found.verdict == "identified" else ", but not surely so"
    return f"the head is not the same for all units: {', '.join(differing)}, another {how}{surely}."


def _all_but(left_out: Collection[int], units: UnitRows) -> str:
    """All units, but those of some numbers."""
    names = [units[k][0] for k in sorted(left_out)]
    more = f" and {len(names) - _MOST_UNITS} more" if len(names) > _MOST_UNITS else ""
    return f"all units but {', '.join(names[:_MOST_UNITS])}{more}" if names else "all units"


def shared_coefficients(found: Together, entries: Catalogue) -> dict[str, dict]:
    """Coefficients of what the head has wrong: value, sd and unit as shown."""
    listed, head = {}, found.fit.head
    if head is None:
        return listed
    units = {name: entries[signal.label].unit for signal in found.shared for name in signal.slot.names}
    for name, base, value, sd in zip(head.names, head.units, head.values, head.sd, strict=True):
        display = units.get(name, shown(base)[0])
        scale = factor(display, base)
        listed[name] = {"value": float(value / scale), "sd": float(sd / scale), "unit": display}
    return listed


def own_estimates(found: Together, number: int, entries: Catalogue) -> dict[str, dict]:
    """A unit's own estimate of each shared coefficient, as shown; nothing of one that it does not show."""
    listed, head = {}, found.fit.head
    sizes = shared_coefficients(found, entries) if found.shared else {}
    for k, name in enumerate(name for signal in found.shared for name in signal.slot.names):
        assert head is not None
        # The head's sd in base units and as shown give the unit.
        scale = sizes[name]["sd"] / float(head.sd[k])
        value, sd = float(found.fit.own_values[number, k] * scale), float(found.fit.own_sd[number, k] * scale)
        if np.isfinite(sd):
            listed[name] = {"value": value, "sd": sd, "unit": sizes[name]["unit"]}
    return listed


def origins(found: Together, entries: Catalogue) -> dict[str, dict]:
    """Head or sensor: for every effect met, what it belongs to and the probabilities that all units share it and that each
    has it by an amount of its own."""
    joint, listed = found.joint, {}
    for id in dict.fromkeys(slot.id for unit in found.units for slot in unit.at.model.slots):
        shared, own = joint.shared_probability(id), joint.spread_probability(id)
        if max(shared, own) > 1e-3 and id in entries:
            listed[id] = {
                "belongs_to": belongs_to(entries[id]),
                "shared": shared,
                "by_unit": own,
            }
    return listed


def origins_by_class(found: Together, entries: Catalogue) -> Iterator[tuple[list[str], dict]]:
    """The origins of the effects met, those of one class of indistinguishable explanations together: they have one
    probability, which is the class's. The most probable first."""
    listed = origins(found, entries)
    classes = [
        {labels[0] for labels in (explanation.told.labels, *explanation.told.equivalents) if len(labels) == 1}
        for explanation in found.joint.explanations
    ]
    done = set[str]()
    for id in sorted(listed, key=lambda id: -listed[id]["shared"] - listed[id]["by_unit"]):
        if id in done:
            continue
        own = next((members for members in classes if id in members), {id})
        alike = [other for other in listed if other == id or (other in own and _same_origin(listed[other], listed[id]))]
        done |= {*alike}
        yield alike, listed[id]


def _same_origin(one: dict, other: dict) -> bool:
    """Whether the origins of two effects are the same as far as a table shows them."""
    close = all(abs(one[name] - other[name]) < 5e-3 for name in ("shared", "by_unit"))
    return close and one["belongs_to"] == other["belongs_to"]


def _shared(found: Together, entries: Catalogue) -> Iterator[str]:
    coefficients = shared_coefficients(found, entries)
    for signal in found.shared:
        sizes = "; ".join(
            f"{name} = {coefficients[name]['value']:.3g} +- {coefficients[name]['sd']:.2g} {coefficients[name]['unit']}"
            for name in signal.slot.names
        )
        yield f"{sizes}. {entries[signal.label].cause} {entries[signal.label].advice}"
    for words in found.unexplained:
        yield f"something that depends like {words}; no entry of the catalogue describes it"


def _levels(found: Together, units: UnitRows, entries: Catalogue) -> Iterator[str]:
    for levels in level_sizes(found, entries):
        before, after = ([units[k][0] for k in (part["first"], part["last"])] for part in levels["parts"])
        told = []
        for (first, last), part in zip((before, after), levels["parts"], strict=True):
            sizes = ", ".join(
                f"{name} = {size['value']:+.3g} +- {size['sd']:.2g} {size['unit']}"
                for name, size in part["coefficients"].items()
            )
            told.append(f"{first} to {last} {sizes or 'not determined by itself'}")
        anew = "set up anew (re-levelled)" if levels["effect"] == "base_levelling" else "set up anew"
        yield (
            f"{levels['effect']}: two levels, {'; '.join(told)} ({p_words(levels['p_value'])} for units in any order): the "
            f"head was {anew} between {before[1]} and {after[0]}. Give each part to --units of its own."
        )


def _spreads(found: Together, units: UnitRows, entries: Catalogue) -> Iterator[str]:
    in_order, shown = {own.signal.label for own in found.levels}, shown_in(found)
    for id, sizes in spread_sizes(found, entries).items():
        if id in in_order:
            continue
        told = "; ".join(
            f"{name} {_mean(size)}, sd between units {size['sd_between_units']:.2g} {size['unit']}"
            for name, size in sizes.items()
        )
        part = ", or a part of what no entry describes" if found.unexplained else ""
        yield (
            f"{id}: {_where(shown[id], units)}: not an error that the head has by itself{part} ({told}). {entries[id].cause}"
        )


def _where(shown: Sequence[int], units: UnitRows) -> str:
    """Which units show an effect that is of another size in each."""
    if len(shown) == len(units):
        return "in all units, but of another size in each"
    if not shown:
        return "in the units together, in none of them clearly by itself"
    more = ", ..." if len(shown) > _MOST_UNITS else ""
    names = ", ".join(units[k][0] for k in shown[:_MOST_UNITS])
    return f"in {len(shown)} of {len(units)} units ({names}{more}), of another size in each"


def _mean(size: dict) -> str:
    if size["mean"] is None:
        return "of an undetermined mean"
    return f"{size['mean']:.2g} +- {size['mean_sd']:.1g} on average"


def _others(explanations: Sequence[SharedExplanation], best: SharedExplanation) -> Iterator[str]:
    others = [told for told in explanations if told is not best and told.probability > _LEAST_TOLD][:4]
    if others:
        yield f"Other explanations: {'; '.join(f'{explanation_words(told)} {told.probability:.2f}' for told in others)}."


def explanation_words(told: SharedExplanation) -> str:
    """What the units share, and what differs from unit to unit."""
    shared = label_words(told.told.labels) or "nothing shared"
    return shared + (f" ({', '.join(told.spreads)} by unit)" if told.spreads else "")


def _pitch(found: Together, units: UnitRows) -> Iterator[str]:
    fit = found.fit
    if fit.pitch.p_value is None:
        return
    if fit.pitch.common:
        assert fit.head is not None
        sizes = "; ".join(
            f"{name} = {value * 1e3:.3g} +- {sd * 1e3:.2g} mrad"
            for name, value, sd in zip(fit.head.names, fit.head.values, fit.head.sd, strict=True)
            if name.startswith(PITCH)
        )
        rest = _all_but({*fit.aside, *fit.pitch.alone}, units)
        yield f"Pitch settings: their errors are the same in {rest} ({p_words(fit.pitch.p_value)}), the head's: {sizes}."
        if fit.pitch.alone:
            others = ", ".join(units[k][0] for k in fit.pitch.alone)
            yield f"Pitch labels or settings of {others} are others; look at them apart."
    elif fit.pitch.changed is not None:
        last, first = units[fit.pitch.changed - 1][0], units[fit.pitch.changed][0]
        yield (
            f"Pitch settings: their errors are the same up to {last}, and others, the same again, from {first} on "
            f"({p_words(fit.pitch.p_value)} of one for all): the axis was set up anew between them. Give each part to --units "
            "of its own."
        )
    else:
        yield (
            f"Pitch settings: their errors differ from unit to unit ({p_words(fit.pitch.p_value)}): set anew each time, not "
            "the head's."
        )


def _own(found: Together, units: UnitRows) -> Iterator[str]:
    told = {own.signal.label for own in found.levels}
    rows = [(k, name, row) for k, (name, row) in enumerate(units) if row.get("causes")]
    own = [
        f"{name}: {row['causes']} ({row['probability']:.2f})"
        for k, name, row in rows
        if k not in found.nothing_of_their_own and not told >= {*row["causes"].split(" + ")}
    ]
    same = [name for k, name, _ in rows if k in found.nothing_of_their_own]
    if same:
        more = f" and {len(same) - _MOST_UNITS} more" if len(same) > _MOST_UNITS else ""
        yield f"By themselves, under whatever name, {', '.join(same[:_MOST_UNITS])}{more} show that error of the head again."
    if own:
        more = f"; and {len(own) - _MOST_UNITS} more" if len(own) > _MOST_UNITS else ""
        yield f"Errors of individual units: {'; '.join(own[:_MOST_UNITS])}{more}."
    outlying = [units[k][0] for k in found.outlying]
    if outlying:
        left = " They are left out of all that is said of the head." if found.fit.aside else ""
        yield (
            "These do not show what the others share, or not as much of it, or have pitch settings of their own: "
            f"{', '.join(outlying)}.{left} Look at them apart, at the angles in their files first."
        )
