"""All files of a diagnosis in one folder; `diagnosis.json` has everything found in one record (DESIGN section 6)."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tumblecal.data.calibration import calibration_text
from tumblecal.data.source_of import source_of
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.sets.explanation import Explanation
from tumblecal.ground.atomic import writable_folder, write_texts
from tumblecal.ground.gravity import record_of
from tumblecal.ground.json_file import json_text
from tumblecal.planning import NextPlan
from tumblecal.report.cause_words import coefficients, combined, temperature_orders, unexplained_words
from tumblecal.report.diagnosis_calibration import diagnosed_use
from tumblecal.report.diagnosis_details import shifts
from tumblecal.report.diagnosis_tables import leading
from tumblecal.report.diagnosis_verdict import verdict_of_diagnosis
from tumblecal.report.next_plan_files import next_plan_texts
from tumblecal.report.rig_files import NAME as EXTENDED_RIG
from tumblecal.report.rig_files import extended_rig_text
from tumblecal.report.unnamed_words import SUGGESTED, suggested_effect_text, unnamed_record
from tumblecal.report.verdict import Verdict, verdict_lines


SCHEMA = "tumblecal.diagnosis/1"
_MOST_EXPLANATIONS = 10


def record(diagnosis: Diagnosis, plan: NextPlan, verdict: Verdict | None = None) -> dict[str, Any]:
    """The diagnosis as plain numbers, lists and texts; coefficients as shown, the rest in g and rad; `verdict`: as for
    `write_diagnosis`."""
    verdict = verdict or verdict_of_diagnosis(diagnosis, plan)
    test = diagnosis.screened.detection
    return {
        "schema": SCHEMA,
        "source": diagnosis.data.source,
        "sha256": source_of(diagnosis.data)["sha256"],
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
        "noise_rivals": {
            label: fault.alternative for label, fault in diagnosis.noise_wrong.items() if fault.alternative
        },
        "assumed_noise_p_value": diagnosis.assumed_p_value,
        "mountings": {label: {"rotation_deg": list(turn)} for label, turn in diagnosis.mountings.items()} or None,
        "samples": None if diagnosis.samples is None else diagnosis.samples.record(),
        "sigma_g": diagnosis.sigma_g,
        "explanations": _explanations(diagnosis),
        "located": [located._asdict() for located in diagnosis.located],
        "unexplained": unexplained_words(diagnosis) or None,
        "excess": unnamed_record(diagnosis.unnamed),
        "gain": vars(diagnosis.gain),
        "shifts": shifts(diagnosis),
        "detection_limits": {
            id: {"limits": limit.coefficients, "unit": limit.unit, "visible_fraction": limit.visible_fraction}
            for id, limit in diagnosis.limits.items()
        },
        "invisible": {id: vars(hidden) for id, hidden in diagnosis.invisible.items()},
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
            "confirming": [_with(reading, "sd_apart") for reading in plan.confirming],
        },
        "next": {
            "conditions": _conditions(plan),
            "promise": None if plan.promise is None else _with(plan.promise, "made", "worth_measuring"),
        },
        "harmonics": [vars(harmonic) for harmonic in diagnosis.harmonics],
        "predictive_checks": [_with(check, "outside") for check in diagnosis.checks],
        "predictive_checks_after": [_with(check, "outside") for check in diagnosis.checks_after],
    }


def _conditions(plan: NextPlan) -> dict | None:
    """The conditions that a plan supposes; `mounting`: how the triad is turned in its fixture, "" for the present mounting."""
    if plan.conditions is None:
        return None
    mounting = list(dict.fromkeys(position.mount for position in plan.together))
    return {**plan.conditions._asdict(), "mounting": mounting, "order": "as listed in the plan"}


def _with(one: object, *properties: str) -> dict:
    """The fields of a record with some of its properties."""
    return vars(one) | {name: getattr(one, name) for name in properties}


def _parameters(diagnosis: Diagnosis) -> dict[str, dict]:
    """Each parameter that is not of one position, as calibration.json states it, base units: value, standard uncertainty `u`
    (None if no position in the fit depends on it) and its contributions, which add in quadrature."""
    used, model = diagnosis.in_use, diagnosis.model
    sd, parts = used.sd, used.parts
    return {
        name: {"value": float(used.values[k]), "u": None if used.idle[k] else float(sd[k]), "unit": model.units[k]}
        | {part: float(sizes[k]) for part, sizes in parts.items()}
        for k, name in enumerate(model.names)
        if not model.layout.of_positions[k]
    }


def _explanations(diagnosis: Diagnosis) -> list[dict]:
    of_data = dict.fromkeys(setup_error.label for setup_error in diagnosis.setup_errors)
    rows = [_explanation(diagnosis, explanation) for explanation in leading(diagnosis, 1e-4, _MOST_EXPLANATIONS)]
    for row in rows:
        noise = (label for label in diagnosis.noise_labels if label not in row["effects"])
        row["effects"] = [*of_data, *noise, *row["effects"]]
    return sorted(rows, key=lambda row: not row["chosen"])


def _explanation(diagnosis: Diagnosis, explanation: Explanation) -> dict:
    chosen = explanation is diagnosis.best
    members = diagnosis.members if chosen else ()
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
        "coefficients": {name: value for cause in members for name, value in coefficients(diagnosis, cause).items()},
        "combinations": [combination for cause in members for combination in combined(diagnosis, cause)],
        "temperature_orders": temperature_orders(members),
    }


def _named(sets: Sequence[tuple[str, ...]]) -> list[list[str]]:
    return [[label.replace(":", " at ", 1) for label in labels] for labels in sets]


def _positions(labels: tuple[str, ...]) -> dict[str, list[str]]:
    """The positions at fault by their faults."""
    listed: dict[str, list[str]] = {}
    for id, _, positions in (label.partition(":") for label in labels if ":" in label):
        listed.setdefault(id, []).extend(positions.split("+"))
    return listed


def write_diagnosis(
    folder: Path,
    diagnosis: Diagnosis,
    plan: NextPlan,
    *,
    figures: bool,
    said: Mapping[str, Any] | None = None,
    verdict: Verdict | None = None,
) -> list[str]:
    """Write diagnosis.json, verdict.txt; calibration.json, extended_rig.toml, suggested_effect.py and plans if there are any;
    figures and page.

    `said`: what else the provenance of the calibration says, such as of the head (`MeasuredHead.record`). `verdict`: the record
    to write; by default that of the diagnosis, with commands for this folder.

    **Returns:** their names.
    """
    if not folder.is_dir():
        writable_folder(folder)
    verdict = verdict or verdict_of_diagnosis(diagnosis, plan, folder)
    content = record(diagnosis, plan, verdict)
    texts = {"diagnosis.json": json_text(content), "verdict.txt": content["text"] + "\n"}
    if (calibration := diagnosis.calibration) is not None:
        provenance = calibration.provenance | dict(said or {})
        texts["calibration.json"] = calibration_text(replace(calibration, provenance=provenance))
    if rig := extended_rig_text(diagnosis):
        texts[EXTENDED_RIG] = rig
    if suggested := suggested_effect_text(diagnosis):
        texts[SUGGESTED] = suggested
    texts |= next_plan_texts(diagnosis, plan, folder)
    write_texts(folder, texts)
    names = [*texts]
    if figures:
        from tumblecal.report.diagnosis_page import write_diagnosis_page
        from tumblecal.show.figures.diagnosis import figures_of
        from tumblecal.show.figures.drawing import write_each

        drawn = write_each(folder, figures_of(diagnosis), diagnosis)
        names += [*drawn, *write_diagnosis_page(folder / "diagnosis.html", diagnosis, plan, drawn, verdict)]
    return names
