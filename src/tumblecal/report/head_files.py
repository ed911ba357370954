"""All files of units on one head: diagnosis.json of the batch, verdict, head.toml, the page with its figure."""

from pathlib import Path

from tumblecal.diagnosis.head import Together
from tumblecal.effects import Catalogue
from tumblecal.ground.atomic import write_text
from tumblecal.report.diagnosis_file import SCHEMA, write_json
from tumblecal.report.hand_held_units import session
from tumblecal.report.head_amounts import UnitRows, level_sizes, shown_in, spread_sizes
from tumblecal.report.head_page import write_head_page
from tumblecal.report.head_words import origins, own_estimates, shared_coefficients, units_text


_MOST_EXPLANATIONS, _LEAST_SHOWN = 10, 1e-4


def write_units(
    folder: Path, found: Together, units: UnitRows, entries: Catalogue, *, figures: bool = True
) -> list[str]:
    """Write all files of units on one head.

    **Arguments:**

    - `units`: folder and summary line of each, in order. `figures`: whether to write the page and its figure.

    **Returns:** the files' names.
    """
    text = units_text(found, units, entries)
    write_json(folder / "diagnosis.json", record(found, units, entries, text))
    write_text(folder / "verdict.txt", text + "\n")
    names = ["diagnosis.json", "verdict.txt", "summary.csv"]
    (folder / "head.toml").unlink(missing_ok=True)
    if found.measured is not None:
        write_text(folder / "head.toml", found.measured.text())
        names.append("head.toml")
    return [*names, *(write_head_page(folder, found, units, entries) if figures else [])]


def record(found: Together, units: UnitRows, entries: Catalogue, text: str) -> dict:
    """The batch as plain numbers, lists and texts, in the schema of one diagnosis, with `units` added."""
    joint, fit, best = found.joint, found.fit, found.joint.best
    known = all(unit.at.problem.known for unit in found.units)
    shown = [one for one in joint.explanations if one.probability > _LEAST_SHOWN or one is best][:_MOST_EXPLANATIONS]
    shown.sort(key=lambda explanation: explanation is not best)
    listed = []
    for number, (name, row) in enumerate(units):
        causes = row["causes"].split(" + ") if row.get("causes") else []
        listed.append(
            {
                "source": row["file"],
                "folder": name,
                "verdict": row["verdict"],
                "effects": [cause.split(":")[0] for cause in causes],
                "causes": causes,
                "probability": row.get("probability"),
                "p_value": row.get("p_value"),
                "outlying": number in found.outlying,
                "left_out": number in fit.aside,
                "same_as_shared": bool(causes) and number in found.nothing_of_their_own,
                "agrees_p_value": found.consistent[number],
                "shared": own_estimates(found, number, entries),
                "fault": row.get("fault"),
            }
        )
    return {
        "schema": SCHEMA,
        "source": session(found, len(units)),
        "verdict": found.verdict,
        "text": text,
        "implausible": [vars(unusual) for unusual in found.implausible],
        "causes": list(best.told.labels),
        "detection": {
            "statistic": joint.statistic,
            "threshold": joint.threshold,
            "dof": joint.dof,
            "p_value": joint.p_value,
            "noise": "stated" if known else "estimated",
        },
        "explanations": [
            {
                "effects": list(explanation.told.labels),
                "equivalents": [list(labels) for labels in explanation.told.equivalents],
                "by_unit": list(explanation.spreads),
                "probability": explanation.probability,
                "chosen": explanation is best,
                "coefficients": shared_coefficients(found, entries) if explanation is best else {},
            }
            for explanation in shown
        ],
        "unexplained": "; ".join(found.unexplained) or None,
        "origins": origins(found, entries),
        "by_unit": spread_sizes(found, entries),
        "shown_in": {id: [units[k][0] for k in numbers] for id, numbers in shown_in(found).items()},
        "levels": [
            levels
            | {"parts": [part | {key: units[part[key]][0] for key in ("first", "last")} for part in levels["parts"]]}
            for levels in level_sizes(found, entries)
        ],
        "pitch_settings": {
            "p_value": fit.pitch.p_value,
            "common": fit.pitch.common,
            "other_in": [units[k][0] for k in fit.pitch.alone],
            "changed_at": units[fit.pitch.changed][0] if fit.pitch.changed is not None else None,
        },
        "units": listed,
    }
