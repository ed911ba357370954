"""`diagnosis.json` of units on one head: the schema of one diagnosis, with `units` and more; and sizes in display units."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tumblecal.diagnosis.units.joint import JointDiagnosis
from tumblecal.diagnosis.units.unit import SharedSignal
from tumblecal.effects import Catalogue
from tumblecal.effects.catalogue import belongs_to
from tumblecal.ground.units import factor, shown


# Folder and summary line of each unit, in the order of the files.
UnitRows = Sequence[tuple[str, Mapping[str, Any]]]
# A value and its standard uncertainty (`sd`) with their unit, by the name of the coefficient.
Sizes = dict[str, dict[str, Any]]
# An origin, and an explanation, of a smaller probability is not listed.
_LEAST_ORIGIN, _MOST_EXPLANATIONS, _LEAST_PROBABLE = 1e-3, 10, 1e-4


def head_sizes(found: JointDiagnosis, entries: Catalogue, unit: int | None = None) -> Sizes:
    """The errors of the head: by all units, or the estimate of one unit, without those that it does not determine."""
    fit, sizes = found.fit, Sizes()
    if (head := fit.head) is None:
        return {}
    display = {name: entries[signal.label].unit for signal in found.shared for name in signal.slot.names}
    values, sds = (head.values, head.sd) if unit is None else (fit.unit_values[unit], fit.unit_sd[unit])
    # The estimates of a unit do not include pitch settings, which are last.
    for name, base, value, sd in zip(head.names, head.units, values.tolist(), sds.tolist(), strict=False):
        if np.isfinite(sd):
            words = display.get(name, shown(base)[0])
            scale = factor(words, base)
            sizes[name] = {"value": value / scale, "sd": sd / scale, "unit": words}
    return sizes


def spread_sizes(found: JointDiagnosis, entries: Catalogue) -> dict[str, Sizes]:
    """For each effect that differs between units: the mean of every coefficient, its standard uncertainty by the noise, and the
    standard deviation between units. Mean and uncertainty are None for a coefficient that is not determined separately."""
    listed: dict[str, Sizes] = {}
    for id in found.joint.best.by_unit:
        amounts = found.amounts[id]
        names, scales = _names_and_scales(amounts.signal, entries)
        columns = (*(part * scales for part in amounts.mean), amounts.tau * scales, amounts.determined)
        listed[id] = {
            name: {
                "mean": mean if alone else None,
                "mean_sd": sd if alone else None,
                "sd_between_units": between,
                "unit": entries[id].unit,
            }
            for name, mean, sd, between, alone in zip(names, *(column.tolist() for column in columns), strict=True)
        }
    return listed


def level_sizes(found: JointDiagnosis, entries: Catalogue, units: UnitRows) -> list[dict[str, Any]]:
    """For each error of the head with two levels: its p-value and, for each part, the first and last unit and every
    coefficient that is determined separately."""
    listed = []
    for levels in found.levels:
        id = levels.signal.label
        names, scales = _names_and_scales(levels.signal, entries)
        alone, parts = found.amounts[id].determined, []
        bounds = (0, levels.first - 1), (levels.first, len(units) - 1)
        for (first, last), values, sds in zip(bounds, levels.values * scales, levels.sd * scales, strict=True):
            sizes = zip(names, values.tolist(), sds.tolist(), alone, strict=True)
            own = {
                name: {"value": value, "sd": sd, "unit": entries[id].unit} for name, value, sd, known in sizes if known
            }
            parts.append({"first": units[first][0], "last": units[last][0], "coefficients": own})
        listed.append({"effect": id, "p_value": levels.p_value, "parts": parts})
    return listed


def _names_and_scales(signal: SharedSignal, entries: Catalogue) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the coefficients of an effect, and the scales to display units."""
    names, bases = zip(*signal.names_and_units, strict=True)
    return names, np.array(signal.scales) / [factor(entries[signal.label].unit, base) for base in bases]


def origins(found: JointDiagnosis, entries: Catalogue) -> dict[str, dict[str, Any]]:
    """Head or sensor: for every effect, the part that it belongs to, and the probabilities that all units share it and that it
    differs between units."""
    listed = {}
    for id in dict.fromkeys(
        slot.id for unit in found.batch.units for slot in unit.at.model.slots if slot.id in entries
    ):
        shared, by_unit = found.joint.shared_probability(id), found.joint.by_unit_probability(id)
        if max(shared, by_unit) > _LEAST_ORIGIN:
            listed[id] = {"belongs_to": belongs_to(entries[id]), "shared": shared, "by_unit": by_unit}
    return listed


def units_record(found: JointDiagnosis, units: UnitRows, entries: Catalogue, source: str, text: str) -> dict[str, Any]:
    """The units together as plain numbers, lists and texts; `source`: the batch in words, `text`: the verdict."""
    joint, pitch, best = found.joint, found.fit.pitch, found.joint.best
    listed = [one for one in joint.explanations if one.probability > _LEAST_PROBABLE or one is best]
    names = [name for name, _ in units]
    return {
        "schema": "tumblecal.diagnosis/1",
        "source": source,
        "verdict": found.verdict,
        "text": text,
        "implausible": found.implausible,
        "causes": best.shared.labels,
        "detection": {
            "statistic": joint.statistic,
            "threshold": joint.threshold,
            "dof": joint.dof,
            "p_value": joint.p_value,
            "noise": "stated" if found.batch.noise_known else "estimated",
        },
        "explanations": [
            {
                "effects": one.shared.labels,
                "equivalents": one.shared.equivalents,
                "by_unit": one.by_unit,
                "probability": one.probability,
                "chosen": one is best,
                "coefficients": head_sizes(found, entries) if one is best else {},
            }
            for one in sorted(listed[:_MOST_EXPLANATIONS], key=lambda one: one is not best)
        ],
        "unexplained": "; ".join(found.unexplained) or None,
        "origins": origins(found, entries),
        "by_unit": spread_sizes(found, entries),
        "shown_in": {id: [names[k] for k in found.amounts[id].shown_in] for id in best.by_unit},
        "levels": level_sizes(found, entries, units),
        "pitch_settings": {
            "p_value": pitch.p_value,
            "common": pitch.common,
            "other_in": [names[k] for k in pitch.alone],
            "changed_at": None if pitch.changed is None else names[pitch.changed],
        },
        "units": [_unit(found, number, name, row, entries) for number, (name, row) in enumerate(units)],
    }


def _unit(found: JointDiagnosis, number: int, name: str, row: Mapping[str, Any], entries: Catalogue) -> dict[str, Any]:
    causes = row["causes"].split(" + ") if row.get("causes") else []
    return {
        "source": row["file"],
        "folder": name,
        "verdict": row["verdict"],
        "effects": [cause.partition(":")[0] for cause in causes],
        "causes": causes,
        "probability": row.get("probability"),
        "p_value": row.get("p_value"),
        "outlying": number in found.outlying,
        "left_out": number in found.fit.excluded,
        "same_as_shared": bool(causes) and number in found.nothing_of_their_own,
        "agrees_p_value": found.fit.consistent[number],
        "shared": head_sizes(found, entries, number),
        "fault": row.get("fault"),
    }
