"""`diagnosis.json` of units on one head: the schema of one diagnosis, with `units` and more added."""

from collections.abc import Mapping
from typing import Any

from tumblecal.diagnosis.units.joint import JointDiagnosis
from tumblecal.diagnosis.units.sizes import UnitRows, head_sizes, level_sizes, origins, spread_sizes
from tumblecal.effects import Catalogue


_MOST_EXPLANATIONS, _LEAST_PROBABLE = 10, 1e-4


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
