"""`diagnosis.json`: everything found, in one record (DESIGN section 6)."""

import json
import math
from collections.abc import Sequence
from pathlib import Path

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.sets.classes import Explanation
from tumblecal.ground.atomic import write_text
from tumblecal.ground.gravity import record_of
from tumblecal.planning import NextPlan
from tumblecal.planning.promise import Promise
from tumblecal.report.cause_words import coefficients, combined, unexplained_words
from tumblecal.report.diagnosis_calibration import diagnosed_use
from tumblecal.report.diagnosis_details import shifts
from tumblecal.report.diagnosis_tables import leading
from tumblecal.report.diagnosis_verdict import verdict_of_diagnosis
from tumblecal.report.unnamed_words import unnamed_record
from tumblecal.report.verdict import verdict_lines


SCHEMA = "tumblecal.diagnosis/1"
_MOST_EXPLANATIONS = 10


def record(diagnosis: Diagnosis, plan: NextPlan, folder: Path | None = None) -> dict:
    """The diagnosis as plain numbers, lists and texts; coefficients as shown, the rest in g and rad; `folder`: where its plans
    are written."""
    verdict = verdict_of_diagnosis(diagnosis, plan, folder)
    test = diagnosis.screened.detection
    return {
        "schema": SCHEMA,
        "source": diagnosis.data.source,
        "gravity": record_of(diagnosis.data.gravity),
        "verdict": diagnosis.verdict,
        "use": diagnosed_use(diagnosis).record(),
        "text": "\n".join(verdict_lines(verdict)),
        "findings": [vars(finding) for finding in verdict.found],
        "unresolved": [vars(question) for question in verdict.unresolved],
        "causes": list(diagnosis.labels),
        "set_up": [setup_error.record() for setup_error in diagnosis.setup_errors],
        "implausible": [vars(unusual) for unusual in diagnosis.implausible],
        "detection": {
            "statistic": test.statistic,
            "threshold": test.threshold,
            "dof": test.dof,
            "p_value": test.p_value,
            "noise": "stated" if diagnosis.problem.known else "estimated",
            "chi2": test.chi2 if diagnosis.problem.known else None,
            "chi2_p_value": test.chi2_p_value,
        },
        "noise_model": diagnosis.noise_words or None,
        "noise_rivals": {label: fault.rival for label, fault in diagnosis.noise_wrong.items() if fault.rival},
        "assumed_noise_p_value": diagnosis.assumed_p_value,
        "mountings": {label: {"rotation_deg": list(turn)} for label, turn in diagnosis.mountings.items()} or None,
        "samples": None if diagnosis.samples is None else diagnosis.samples.record(),
        "sigma_g": diagnosis.sigma_g,
        "explanations": _explanations(diagnosis),
        "located": [located._asdict() for located in diagnosis.located],
        "unexplained": unexplained_words(diagnosis) or None,
        "excess": unnamed_record(diagnosis.unnamed),
        "gain": {key: value for key, value in vars(diagnosis.gain).items()},
        "shifts": shifts(diagnosis),
        "detection_limits": {
            id: {"limits": limit.coefficients, "unit": limit.unit, "visible_fraction": limit.visible_fraction}
            for id, limit in diagnosis.limits.items()
        },
        "invisible": {
            id: {
                "absorbed_by": list(hidden.absorbed_by),
                "direction": hidden.direction,
                "size": hidden.size,
                "unit": hidden.unit,
                "harm": hidden.harm,
            }
            for id, hidden in diagnosis.invisible.items()
        },
        "parameters": _parameters(diagnosis),
        "unseen": {name: vars(known) for name, known in diagnosis.unseen.items()},
        "not_testable": diagnosis.model.not_testable,
        "next_positions": [vars(position) for position in plan.singles],
        "next_plan": {
            "purpose": plan.purpose or None,
            "watched": plan.watched or None,
            "in_reverse": plan.in_reverse,
            "value": plan.value,
            "together": [vars(position) for position in plan.together],
            "notes": list(plan.notes),
            "confirming": [{**vars(reading), "sd_apart": reading.sd_apart} for reading in plan.confirming],
        },
        "next": {
            "conditions": conditions_record(plan),
            "promise": None if plan.promise is None else promise_record(plan.promise),
            "positions_needed": plan.needed,
        },
        "harmonics": [vars(harmonic) for harmonic in diagnosis.harmonics],
        "predictive_checks": [{**vars(check), "outside": check.outside} for check in diagnosis.checks],
        "predictive_checks_after": [{**vars(check), "outside": check.outside} for check in diagnosis.checks_after],
    }


def conditions_record(plan: NextPlan) -> dict | None:
    """The conditions that a plan supposes; `mounting`: how the triad is turned in its fixture, "" for the present mounting."""
    if plan.conditions is None:
        return None
    mounting = list(dict.fromkeys(position.mount for position in plan.together))
    return {**plan.conditions.record(), "mounting": mounting, "order": "as listed in the plan"}


def promise_record(promise: Promise) -> dict:
    """What new positions are expected to settle, with whether that is promised, and whether they are worth measuring."""
    return {**vars(promise), "made": promise.made, "worth_measuring": promise.worth_measuring}


def _parameters(diagnosis: Diagnosis) -> dict[str, dict]:
    """Each parameter that is not of one position, as calibration.json states it, base units: value, standard uncertainty `u`
    and its contributions, which add in quadrature."""
    used, model = diagnosis.in_use, diagnosis.model
    return {
        name: {"value": float(used.values[k]), "u": float(used.sd[k]), "unit": model.units[k]}
        | {part: float(sizes[k]) for part, sizes in used.parts.items()}
        for k, name in enumerate(model.names)
        if not model.layout.of_positions[k]
    }


def write_json(path: Path, content: dict) -> None:
    """Write plain numbers, lists and texts, whole or not at all, as `json_text` has them."""
    write_text(path, json_text(content))


def json_text(content: dict) -> str:
    """Plain numbers, lists and texts as JSON; what is not finite becomes null."""
    try:
        return _text(content)
    except ValueError:
        return _text(_finite(content))


def _text(content: dict) -> str:
    """JSON with a line for every item of the second level: readable, and written in a tenth of the time of `indent`."""
    parts, encoded = [], json.JSONEncoder(allow_nan=False).encode
    for key, value in content.items():
        if isinstance(value, dict) and value:
            inside = ",\n  ".join(f"{encoded(name)}: {encoded(item)}" for name, item in value.items())
            text = f"{{\n  {inside}\n }}"
        elif isinstance(value, list) and value:
            inside = ",\n  ".join(map(encoded, value))
            text = f"[\n  {inside}\n ]"
        else:
            text = encoded(value)
        parts.append(f"{encoded(key)}: {text}")
    return "{\n " + ",\n ".join(parts) + "\n}\n"


def _explanations(diagnosis: Diagnosis) -> list[dict]:
    mixed = list(dict.fromkeys(setup_error.label for setup_error in diagnosis.setup_errors))
    rows = [_explanation(diagnosis, explanation) for explanation in leading(diagnosis, 1e-4, _MOST_EXPLANATIONS)]
    rows.sort(key=lambda row: not row["chosen"])
    for row in rows:
        row["effects"] = [
            *mixed,
            *(label for label in diagnosis.noise_labels if label not in row["effects"]),
            *row["effects"],
        ]
    return rows


def _explanation(diagnosis: Diagnosis, explanation: Explanation) -> dict:
    chosen = explanation is diagnosis.best
    values: dict[str, dict] = {}
    together: list[dict] = []
    for member in diagnosis.members if chosen else ():
        values |= coefficients(diagnosis, member)
        together += combined(diagnosis, member)
    return {
        "effects": [label.split(":")[0] for label in explanation.labels],
        "positions": _positions(explanation.labels),
        "equivalents": _named(explanation.equivalents),
        "identical_at_1_g": _named(explanation.identical),
        "supersets": _named(explanation.supersets),
        "less_simple": _named([labels for labels, _ in explanation.less_probable]),
        "probability": explanation.probability,
        "class_probability": explanation.class_probability,
        "chosen": chosen,
        "coefficients": values,
        "combinations": together,
    }


def _named(sets: Sequence[tuple[str, ...]]) -> list[list[str]]:
    return [[label.replace(":", " at ", 1) for label in labels] for labels in sets]


def _positions(labels: tuple[str, ...]) -> dict[str, list[str]]:
    """The positions at fault, by what is the matter with them."""
    listed: dict[str, list[str]] = {}
    for id, _, positions in (label.partition(":") for label in labels if ":" in label):
        listed.setdefault(id, []).extend(positions.split("+"))
    return listed


def _finite(value):
    """Numbers that are not finite become null: JSON has none."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
