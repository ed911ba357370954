"""Tables of a diagnosis for a page: gain, explanations, parameters, limits, invisible effects, next positions."""

from collections.abc import Sequence

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.sets.classes import Explanation
from tumblecal.ground.numbers_shown import p_words
from tumblecal.ground.units import in_words, shown
from tumblecal.planning.confirming import Confirmation
from tumblecal.planning.next_plan import NextPosition
from tumblecal.report.cause_words import label_words
from tumblecal.report.number_words import bic_words, short
from tumblecal.report.page import PageTable


_MOST_EXPLANATIONS = 10
_MOST_EQUIVALENTS = 8
_MOST_OF_OTHERS = 3
_MOST_HARMED = 3
_JOIN = "\u00a0"
# Headers of the standard uncertainty and of its contributions.
_UNCERTAINTY = ("u", "by noise", "by other explanations", "by undetected effects")


def gain_table(diagnosis: Diagnosis) -> PageTable:
    """Residuals, predictions of data left out, and what a new measurement would show; nominal beside extended."""
    gain = diagnosis.gain
    predicted = f"prediction, {gain.cv_kind}"
    rows = [
        ("residuals, rms", gain.rms_before_g, gain.rms_after_g, None),
        (predicted, gain.cv_rms_before_g, gain.cv_rms_after_g, gain.cv_gain_sd_g),
        ("expected of a new measurement", gain.fresh_rms_before_g, gain.fresh_rms_after_g, gain.fresh_gain_sd_g),
    ]
    cells = [
        [
            name,
            f"{before * 1e3:.4g}",
            f"{after * 1e3:.4g}",
            f"{(before - after) * 1e3:.3g}" + ("" if sd is None else f" ± {short(sd * 1e3)}"),
            "mg",
        ]
        for name, before, after, sd in rows
    ]
    if gain.cv_same_causes is not None:
        cells[1][0] += ", causes chosen anew"
        kept = gain.cv_rms_kept_g
        cells.insert(2, ["the same, causes kept", "", f"{kept * 1e3:.4g}", "", "mg"])
        cells.insert(3, ["folds that choose the same causes", "", f"{gain.cv_same_causes:.0%}", "", ""])
    cells += [
        ["parameters", f"{diagnosis.nominal.parameters}", f"{diagnosis.extended.parameters}", "", ""],
        ["delta BIC (below -10: very strong evidence)", "", "", bic_words(gain.delta_bic), ""],
    ]
    if gain.f_statistic is not None and gain.f_p_value is not None:
        cells.append([f"F test, {p_words(gain.f_p_value)}", "", "", f"F = {gain.f_statistic:.3g}", ""])
    return PageTable(["", "nominal model", "extended model", "gain", "unit"], cells, text=(0, 4))


def leading(diagnosis: Diagnosis, least: float, most: int) -> list[Explanation]:
    """Explanations more probable than `least`, and the one acted on; the first `most` of them."""
    return [e for e in diagnosis.screened.explanations if e.probability > least or e is diagnosis.best][:most]


def explanations_table(diagnosis: Diagnosis) -> PageTable:
    """Explanations, most probable first, with the sets that make the same signal."""
    nothing = "nothing else is wrong" if diagnosis.mix_ups or diagnosis.noise_labels else "adequate: nothing is wrong"
    rows = [
        [
            (label_words(explanation.labels) or nothing) + (" (acted on)" if explanation is diagnosis.best else ""),
            f"{explanation.probability:.3f}",
            f"{explanation.own_probability:.3f}",
            _equivalents(explanation, _MOST_EQUIVALENTS if explanation is diagnosis.best else _MOST_OF_OTHERS),
        ]
        for explanation in leading(diagnosis, 1e-3, _MOST_EXPLANATIONS)
    ]
    return PageTable(
        ["explanation", "probability", "this one alone", "the data cannot tell it from"], rows, text=(0, 3)
    )


def _equivalents(explanation: Explanation, most: int) -> str:
    words = "; ".join(label_words(labels) for labels in explanation.equivalents[:most])
    more = len(explanation.equivalents) - most
    return f"{words}; and {more} more" if more > 0 else words


def parameters_table(diagnosis: Diagnosis) -> PageTable:
    """Every nominal parameter of the sensor and its set-up as calibration.json has it, with its standard uncertainty and the
    contributions to it; the nominal model's value before it where another is written."""
    chain, inserted = diagnosis.model.nominal_chain, diagnosis.extended is not diagnosis.nominal
    used, rows = diagnosis.in_use, []
    for k, name in enumerate(chain.names):
        if diagnosis.model.layout.of_positions[k]:  # the tilts of a hand-held set
            continue
        unit, scale = shown(chain.units[k])
        values = [*([diagnosis.nominal.values[k]] if inserted else []), used.values[k], used.sd[k]]
        values += [sizes[k] for sizes in used.parts.values()]
        cells = [name, unit, *(f"{value * scale:.4f}" for value in values)]
        if inserted:
            moved = used.values[k] - diagnosis.nominal.values[k]
            # Adding zero turns a rounded -0.0 into 0.0.
            cells += [f"{round(moved * scale, 4) + 0.0:+.4f}", f"{round(moved / used.sd[k], 1) + 0.0:+.1f}"]
        rows.append(cells)
    if not inserted:
        return PageTable(["parameter", "unit", "value", *_UNCERTAINTY], rows, text=(1,))
    header = ["parameter", "unit", "nominal model", "as written", *_UNCERTAINTY, "moved by", "in u"]
    return PageTable(header, rows, text=(1,))


def limits_table(diagnosis: Diagnosis) -> PageTable:
    """The smallest size of every coefficient that would be diagnosis, in the catalogue's order."""
    rows = [
        [
            id if not number else "",
            coefficient if len(limit.coefficients) > 1 else "",
            "not visible" if size is None else f"{size:.3g}",
            limit.unit,
            f"{diagnosis.entries[id].typical:g}",
            f"{limit.visible_fraction:.0%}",
        ]
        for id, limit in _in_order(diagnosis, diagnosis.limits).items()
        for number, (coefficient, size) in enumerate(limit.coefficients.items())
    ]
    header = ["effect", "coefficient", "limit (80 % power)", "unit", "typical size", "visible"]
    return PageTable(header, rows, text=(1, 3))


def invisible_table(diagnosis: Diagnosis) -> PageTable:
    """Effects, or directions of them, that the nominal parameters take up, and what they would do unseen."""
    rows = []
    for id, hidden in _in_order(diagnosis, diagnosis.invisible).items():
        direction = ", ".join(f"{share:+.2f}{_JOIN}{_suffix(name, id)}" for name, share in hidden.direction.items())
        harms = []
        for name, harm in list(hidden.harm.items())[:_MOST_HARMED]:
            unit, scale = shown(str(harm["unit"]))
            size = in_words(f"{harm['shift'] * scale:+.3g}", unit)
            harms.append(f"{name} by {size} ({harm['in_sd']:+.1f} sd)".replace(" ", _JOIN))
        if len(hidden.harm) > _MOST_HARMED:
            harms.append(f"and{_JOIN}{len(hidden.harm) - _MOST_HARMED}{_JOIN}more")
        alone = len(hidden.direction) == 1 and id in hidden.direction
        rows.append([id, "" if alone else direction, in_words(hidden.size, hidden.unit), ", ".join(harms)])
    header = ["invisible effect", "direction", "size", "would move"]
    return PageTable(header, rows, text=(1, 2, 3))


def _suffix(name: str, id: str) -> str:
    return name.removeprefix(id).lstrip("_") or name


def _in_order(diagnosis: Diagnosis, listed: dict) -> dict:
    """Sorted as the catalogue is."""
    return {id: listed[id] for id in diagnosis.entries if id in listed}


def not_testable_table(diagnosis: Diagnosis) -> PageTable:
    """The effects that were not tried, by the reason."""
    reasons: dict[str, list[str]] = {}
    for id, reason in diagnosis.model.not_testable.items():
        reasons.setdefault(reason, []).append(id)
    return PageTable(["reason", "effects"], [[reason, ", ".join(ids)] for reason, ids in reasons.items()], text=(0, 1))


def next_table(proposed: Sequence[NextPosition]) -> PageTable:
    """Proposed positions in their order."""
    if any(position.direction for position in proposed):
        worth = [[f"{k}", own.direction, f"{own.value:.0%}"] for k, own in enumerate(proposed, start=1)]
        return PageTable(["", "attitude", "worth"], worth, text=(1,))
    rows = [
        [
            f"{rank}",
            ", ".join(f"{alpha:g}" for alpha in position.turn_deg or (position.alpha_deg,)),
            f"{position.beta_deg:g}",
            position.mount or "as it is",
            f"{position.value:.2f}" if position.purpose.startswith("separate") else f"{position.value:.0%}",
        ]
        for rank, position in enumerate(proposed, start=1)
    ]
    return PageTable(["", "alpha / deg", "beta / deg", "triad in its fixture", "worth"], rows, text=(3,))


def confirming_table(readings: Sequence[Confirmation]) -> PageTable:
    """Readings that test the named cause."""
    rows = [
        [
            f"{reading.alpha_deg:g}",
            f"{reading.beta_deg:g}",
            reading.axis,
            f"{reading.expected_g:.6f}",
            f"{reading.expected_sd_g * 1e3:.2g}",
            f"{reading.rival_g:.6f}",
            f"{reading.sd_g * 1e3:.2g}",
            f"{reading.sd_apart:.1f}",
        ]
        for reading in readings
    ]
    names = ["alpha / deg", "beta / deg", "axis", "if it is so / g", "sd / mg", "if not / g", "sd / mg", "apart / sd"]
    return PageTable(names, rows, text=(2,))
