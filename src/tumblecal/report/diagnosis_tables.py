"""Tables of a diagnosis for a page: gain, explanations, parameters, limits, invisible effects, next positions."""

from tumblecal.chain.units import shown
from tumblecal.diagnosis.diagnose import Diagnosis
from tumblecal.diagnosis.explanations import Explanation
from tumblecal.diagnosis.verdict import label_words, shifts
from tumblecal.report.page import PageTable


_MOST_EXPLANATIONS = 10
_MOST_EQUIVALENTS = 12
_MOST_HARMED = 3


def gain_table(found: Diagnosis) -> PageTable:
    """Residuals, predictions of data left out, and what a new measurement would show; nominal beside extended."""
    gain = found.gain
    rows = [
        ("residuals, rms", gain.rms_before_g, gain.rms_after_g, None),
        (f"prediction, {gain.cv_kind}", gain.cv_rms_before_g, gain.cv_rms_after_g, gain.cv_gain_sd_g),
        ("expected of a new measurement", gain.fresh_rms_before_g, gain.fresh_rms_after_g, gain.fresh_gain_sd_g),
    ]
    cells = [
        [
            name,
            f"{before * 1e3:.4g}",
            f"{after * 1e3:.4g}",
            f"{(before - after) * 1e3:.3g}" + ("" if sd is None else f" ± {sd * 1e3:.1g}"),
            "mg",
        ]
        for name, before, after, sd in rows
    ]
    cells += [
        ["parameters", f"{found.nominal.parameters}", f"{found.extended.parameters}", "", ""],
        ["delta BIC (below -10: very strong evidence)", "", "", f"{gain.delta_bic:.1f}", ""],
    ]
    if gain.f_statistic is not None and gain.f_p_value is not None:
        cells.append([f"F test, p = {gain.f_p_value:.2g}", "", "", f"F = {gain.f_statistic:.3g}", ""])
    return PageTable(["", "nominal model", "extended model", "gain", "unit"], cells)


def explanations_table(found: Diagnosis) -> PageTable:
    """Explanations, most probable first, with the sets that make the same signal."""
    listed = [one for one in found.screened.explanations if one.probability > 1e-3 or one is found.best]
    rows = [
        [
            (label_words(one.labels) or "adequate: nothing is wrong") + (" (acted on)" if one is found.best else ""),
            f"{one.probability:.3f}",
            f"{one.own_probability:.3f}",
            _equivalents(one),
        ]
        for one in listed[:_MOST_EXPLANATIONS]
    ]
    return PageTable(["explanation", "probability", "this one alone", "the data cannot tell it from"], rows, text=(0, 3))


def _equivalents(one: Explanation) -> str:
    words = "; ".join(label_words(labels) for labels in one.equivalents[:_MOST_EQUIVALENTS])
    more = len(one.equivalents) - _MOST_EQUIVALENTS
    return f"{words}; and {more} more" if more > 0 else words


def parameters_table(found: Diagnosis) -> PageTable:
    """Every nominal parameter before and after the extension, with its sd and how far it moved."""
    chain, inserted = found.model.nominal_chain, found.extended is not found.nominal
    sd = found.extended.vector_sd(found.model)
    moved = shifts(found)
    rows = []
    for k, name in enumerate(chain.names):
        unit, scale = shown(chain.units[k])
        values = [found.nominal.vector[k], found.extended.vector[k]] if inserted else [found.nominal.vector[k]]
        cells = [name, unit, *(f"{value * scale:.4f}" for value in values), f"{sd[k] * scale:.4f}"]
        rows.append([*cells, f"{moved[name]['shift']:+.4f}", f"{moved[name]['in_sd']:+.1f}"] if inserted else cells)
    if not inserted:
        return PageTable(["parameter", "unit", "value", "sd"], rows)
    return PageTable(["parameter", "unit", "nominal model", "extended model", "sd", "moved by", "in sd"], rows)


def limits_table(found: Diagnosis) -> PageTable:
    """The smallest size of every coefficient that would be found, in the catalogue's order."""
    rows = [
        [
            id,
            coefficient,
            "not visible" if size is None else f"{size:.3g}",
            limit.unit,
            f"{found.entries[id].typical:g}",
            f"{limit.visible_fraction:.0%}",
        ]
        for id, limit in _in_order(found, found.limits).items()
        for coefficient, size in limit.coefficients.items()
    ]
    header = ["effect", "coefficient", "limit (80 % power)", "unit", "typical size", "visible"]
    return PageTable(header, rows)


def invisible_table(found: Diagnosis) -> PageTable:
    """Effects, or directions of them, that the nominal parameters take up, and what they would do unseen."""
    rows = []
    for id, one in _in_order(found, found.invisible).items():
        direction = " ".join(f"{share:+.2f} {name}" for name, share in one.direction.items())
        harms = []
        for name, harm in list(one.harm.items())[:_MOST_HARMED]:
            unit, scale = shown(str(harm["unit"]))
            harms.append(f"{name} by {harm['shift'] * scale:+.3g} {unit} ({harm['in_sd']:+.1f} sd)")
        if len(one.harm) > _MOST_HARMED:
            harms.append(f"and {len(one.harm) - _MOST_HARMED} more")
        rows.append([id, direction, f"{one.size:g} {one.unit}", "; ".join(harms)])
    header = ["invisible effect", "direction", "a size met in practice", "would move"]
    return PageTable(header, rows, text=(1, 3))


def _in_order(found: Diagnosis, listed: dict) -> dict:
    """Sorted as the catalogue is."""
    return {id: listed[id] for id in found.entries if id in listed}


def not_testable_table(found: Diagnosis) -> PageTable:
    """The effects that were not tried, by the reason."""
    reasons: dict[str, list[str]] = {}
    for id, reason in found.model.not_testable.items():
        reasons.setdefault(reason, []).append(id)
    return PageTable(["reason", "effects"], [[reason, ", ".join(ids)] for reason, ids in reasons.items()], text=(0, 1))


def next_table(found: Diagnosis) -> PageTable:
    """The proposed positions, best first."""
    rows = [
        [
            f"{rank}",
            f"{one.alpha_deg:g}" if not one.mount else f"{one.alpha_deg:g} to 315, every 45",
            f"{one.beta_deg:g}",
            one.mount or "as it is",
            f"{one.value:.2f}" if one.purpose.startswith("separate") else f"{one.value:.0%}",
        ]
        for rank, one in enumerate(found.next_positions, start=1)
    ]
    return PageTable(["", "alpha / deg", "beta / deg", "triad in its fixture", "worth"], rows, text=(3,))
