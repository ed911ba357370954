"""Tables of a diagnosis: improvement, explanations, parameters, limits, undetectable effects, next positions."""

from collections.abc import Sequence

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.findings.factors import Factor
from tumblecal.diagnosis.sets.exchanges import Labels
from tumblecal.diagnosis.sets.explanation import Explanation
from tumblecal.ground.counted import shortened
from tumblecal.ground.numbers_shown import capped, decimals, p_words, rounded_together, with_decimals
from tumblecal.ground.units import in_words, shown
from tumblecal.planning.confirming import Confirmation
from tumblecal.planning.next_plan import NextPosition
from tumblecal.report.cause_words import label_words
from tumblecal.report.diagnosis_details import harm_in_u
from tumblecal.report.diagnosis_verdict import reason_words
from tumblecal.show.tables import Table


_MOST_EXPLANATIONS = 10
_MOST_OF_OTHERS = 3
_MOST_HARMED = 3
_JOIN = "\u00a0"
# Headers of the standard uncertainty and of its contributions.
_UNCERTAINTY = ("u", "noise", "other explanations", "undetected effects")


def gain_table(diagnosis: Diagnosis) -> Table:
    """Residuals, held-out error, and expected error of a repeat measurement: nominal and extended model."""
    gain = diagnosis.gain
    rows = [
        ("residuals, rms", gain.rms_before_g, gain.rms_after_g, None),
        (f"held-out error, {gain.cv_kind}", gain.cv_rms_before_g, gain.cv_rms_after_g, gain.cv_gain_sd_g),
        ("expected of a repeat measurement", gain.fresh_rms_before_g, gain.fresh_rms_after_g, gain.fresh_gain_sd_g),
    ]
    cells = []
    for name, before, after, u in rows:
        places = decimals(1e3 * (gain.cv_gain_sd_g if u is None else u))
        numbers = [with_decimals(1e3 * size, places) for size in (before, after, before - after)]
        numbers[2] = numbers[2] if u is None else rounded_together((before - after) * 1e3, u * 1e3)
        cells.append([name, *numbers, "mg"])
    if gain.cv_same_causes is not None:
        cells[1][0] += ", cause selection repeated"
        same_causes = with_decimals(gain.cv_rms_kept_g * 1e3, decimals(gain.cv_gain_sd_g * 1e3))
        cells.insert(2, ["the same causes in every fold", "", same_causes, "", "mg"])
        cells.insert(3, ["folds that select the same causes", "", f"{100 * gain.cv_same_causes:.0f} %", "", ""])
    cells += [
        ["parameters", f"{diagnosis.nominal.parameters}", f"{diagnosis.extended.parameters}", "", ""],
        ["delta BIC (below -10: very strong evidence)", "", "", capped(gain.delta_bic, ".1f"), ""],
    ]
    if gain.f_statistic is not None and gain.f_p_value is not None:
        cells.append([f"F test, {p_words(gain.f_p_value)}", "", "", f"F {capped(gain.f_statistic, '.3g')}", ""])
    return Table(["", "nominal model", "extended model", "improvement", "unit"], cells, text=(0, 4))


def leading(diagnosis: Diagnosis, least: float, most: int) -> list[Explanation]:
    """Explanations more probable than `least`, and the one acted on; the first `most` of them."""
    return [e for e in diagnosis.screened.explanations if e.more_probable_than(least) or e is diagnosis.best][:most]


def class_tables(found: Sequence[Factor], best: Explanation) -> list[Table]:
    """Members of the leading class: a matrix of the two findings with the most alternatives (rows: members of one, columns:
    members of the other), and a table for each further finding with alternatives."""
    several = sorted((factor for factor in found if len(factor.members) > 1), key=lambda factor: -len(factor.members))
    if len(several) < 2:
        return [_members_table(factor) for factor in several]
    first, second, *others = several
    matrix = [[_together(row, column, first, second, best) for column in second.members] for row in first.members]
    rows = [[label_words(row), *cells] for row, cells in zip(first.members, matrix, strict=True)]
    header = ["", *map(label_words, second.members)]
    table = Table(header, rows, text=tuple(range(len(header))), marked={(0, 1)})
    return [table, *map(_members_table, others)]


def _together(row: Labels, column: Labels, first: Factor, second: Factor, best: Explanation) -> str:
    """Status in the class of a member of one finding together with a member of another."""
    labels = {*best.labels} - {*first.members[0]} - {*second.members[0]} | {*row} | {*column}
    if labels == {*best.labels}:
        return "leading"
    if any({*member} == labels for member in best.identical):
        return "identical at 1 g"
    return "indistinguishable" if any({*member} == labels for member in best.equivalents) else "not supported"


def _members_table(factor: Factor) -> Table:
    leading, *others = map(label_words, factor.members)
    rows = [
        [leading, "leading"],
        *([other, reason_words(why)] for other, why in zip(others, factor.reasons, strict=True)),
    ]
    return Table(["alternative", "not distinguished because"], rows, text=(0, 1), marked={(0, 1)})


def explanations_table(diagnosis: Diagnosis) -> Table:
    """Explanations, most probable first; the class of the first is in the matrix."""
    nothing = "no other error" if diagnosis.setup_errors or diagnosis.noise_labels else "adequate: no error"
    listed = leading(diagnosis, 1e-3, _MOST_EXPLANATIONS)
    others = any(explanation.equivalents for explanation in listed if explanation is not diagnosis.best)
    rows = [
        [
            (label_words(explanation.labels) or nothing) + (" (acted on)" if explanation is diagnosis.best else ""),
            f"{explanation.probability:.3f}",
            f"{explanation.own_probability:.3f}",
            *([_equivalents(explanation, diagnosis)] if others else []),
        ]
        for explanation in listed
    ]
    header = ["explanation", "probability", "first member alone", *(["indistinguishable from"] if others else [])]
    return Table(header, rows, text=(0, 3), shares=(1,))


def _equivalents(explanation: Explanation, diagnosis: Diagnosis) -> str:
    if explanation is diagnosis.best:
        return ""
    return shortened(list(map(label_words, explanation.stated)), _MOST_OF_OTHERS, "; ", "; and")


def parameters_table(diagnosis: Diagnosis) -> Table:
    """Every nominal parameter of sensor and set-up in calibration.json, with its standard uncertainty and the contributions to
    it; first the value of the nominal model, if that differs."""
    chain, inserted = diagnosis.model.nominal_chain, diagnosis.extended is not diagnosis.nominal
    used, rows = diagnosis.in_use, []
    for k, name in enumerate(chain.names):
        if diagnosis.model.layout.of_positions[k]:  # the tilts of a hand-held set
            continue
        unit, scale = shown(chain.units[k])
        places = decimals(used.sd[k] * scale)
        before = diagnosis.nominal.values[k]
        values = [
            *([before] if inserted else []),
            used.values[k],
            used.sd[k],
            *(part[k] for part in used.parts.values()),
        ]
        change = 0.0 if used.idle[k] else (used.values[k] - before) / used.sd[k]
        cells = [
            *(with_decimals(value * scale, places) for value in values),
            *[capped(change, "+z.1f")][: int(inserted)],
        ]
        if used.idle[k]:
            cells[inserted:] = ["not determined", *[""] * (len(cells) - inserted - 1)]
        rows.append([name, unit, *cells])
    values, change = (["nominal model", "as written"], ["change / u"]) if inserted else (["value"], [])
    return Table(["parameter", "unit", *values, *_UNCERTAINTY, *change], rows, text=(1,))


def limits_table(diagnosis: Diagnosis) -> Table:
    """Detection limit of every coefficient, in the order of the catalogue."""
    rows = [
        [
            id if not number else "",
            coefficient if len(limit.coefficients) > 1 else "",
            "undetectable" if size is None else f"{size:.3g}",
            limit.unit,
            f"{diagnosis.entries[id].typical:g}",
            f"{100 * limit.visible_fraction:.0f} %",
        ]
        for id, limit in _in_order(diagnosis, diagnosis.limits).items()
        for number, (coefficient, size) in enumerate(limit.coefficients.items())
    ]
    header = ["effect", "coefficient", "detection limit (80 % power)", "unit", "typical size", "visible"]
    return Table(header, rows, text=(1, 3))


def invisible_table(diagnosis: Diagnosis) -> Table:
    """Effects, or directions of them, that the nominal parameters absorb, and the changes that they would cause."""
    rows = []
    for id, hidden in _in_order(diagnosis, diagnosis.invisible).items():
        parts = {name.removeprefix(id).lstrip("_") or name: share for name, share in hidden.direction.items()}
        direction = ", ".join(f"{share:+.2f}{_JOIN}{name}" for name, share in parts.items())
        harms, in_u = [], harm_in_u(diagnosis, hidden)
        for name, harm in list(hidden.harm.items())[:_MOST_HARMED]:
            unit, scale = shown(str(harm["unit"]))
            size = in_words(f"{harm['shift'] * scale:+.3g}", unit)
            harms.append(f"{name} by {size} ({capped(in_u[name], '+.1f')} u)".replace(" ", _JOIN))
        if len(hidden.harm) > _MOST_HARMED:
            harms.append(f"and{_JOIN}{len(hidden.harm) - _MOST_HARMED}{_JOIN}more")
        alone = len(hidden.direction) == 1 and id in hidden.direction
        rows.append([id, "" if alone else direction, in_words(hidden.size, hidden.unit), ", ".join(harms)])
    header = ["undetectable effect", "direction", "size", "would change"]
    return Table(header, rows, text=(1, 2, 3))


def _in_order(diagnosis: Diagnosis, listed: dict) -> dict:
    """In the order of the catalogue."""
    return {id: listed[id] for id in diagnosis.entries if id in listed}


def not_testable_table(diagnosis: Diagnosis) -> Table:
    """The effects that cannot be tested, by reason."""
    reasons = diagnosis.model.not_testable
    rows = [
        [one, ", ".join(id for id, why in reasons.items() if why == one)] for one in dict.fromkeys(reasons.values())
    ]
    return Table(["reason", "effects"], rows, text=(0, 1))


def next_table(proposed: Sequence[NextPosition]) -> Table:
    """Proposed positions in their order."""
    if any(position.direction for position in proposed):
        attitudes = [[f"{k}", each.direction, f"{100 * each.value:.0f} %"] for k, each in enumerate(proposed, 1)]
        return Table(["", "attitude", "improvement"], attitudes, text=(1,))
    rows = [
        [
            f"{rank}",
            ", ".join(f"{alpha:g}" for alpha in position.turn_deg or (position.alpha_deg,)),
            f"{position.beta_deg:g}",
            position.mount or "unchanged",
            f"{position.value:.2f}" if position.purpose.startswith("separate") else f"{100 * position.value:.0f} %",
        ]
        for rank, position in enumerate(proposed, start=1)
    ]
    return Table(["", "alpha / deg", "beta / deg", "mounting", "improvement"], rows, text=(3,))


def confirming_table(readings: Sequence[Confirmation], alternative: str) -> Table:
    """Readings that test the named cause against its strongest alternative."""
    rows = [
        [
            f"{reading.alpha_deg:g}",
            f"{reading.beta_deg:g}",
            reading.axis,
            rounded_together(reading.expected_g * 1e3, reading.expected_sd_g * 1e3),
            rounded_together(reading.rival_g * 1e3, reading.sd_g * 1e3),
            capped(reading.sd_apart, ".1f"),
        ]
        for reading in readings
    ]
    predicted = ["predicted by the named cause / mg", f"by {alternative} / mg"]
    return Table(["alpha / deg", "beta / deg", "axis", *predicted, "separation / u"], rows, text=(2,))
