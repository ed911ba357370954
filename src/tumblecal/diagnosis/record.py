"""`diagnosis.json`: a diagnosis in numbers (DESIGN section 6)."""

from collections.abc import Iterable
from typing import Any

from tumblecal.data.source_of import source_of
from tumblecal.diagnosis.coefficients import coefficients, temperature_orders
from tumblecal.diagnosis.diagnosis import Diagnosis
from tumblecal.diagnosis.findings.candidate_law import Law
from tumblecal.diagnosis.findings.unexplained import Unnamed
from tumblecal.diagnosis.sets.explanation import Explanation
from tumblecal.ground.gravity import record_of
from tumblecal.ground.units import shown


SCHEMA = "tumblecal.diagnosis/1"
_LEAST_PROBABLE, _MOST_EXPLANATIONS = 1e-4, 10


def diagnosis_record(diagnosis: Diagnosis) -> dict[str, Any]:
    """The diagnosis as plain numbers, lists and texts; coefficients as shown, the rest in g and rad."""
    test, known = diagnosis.screened.detection, diagnosis.problem.known
    return {
        "schema": SCHEMA,
        "source": diagnosis.data.source,
        "sha256": source_of(diagnosis.data)["sha256"],
        "gravity": record_of(diagnosis.data.gravity),
        "verdict": diagnosis.verdict,
        "causes": diagnosis.labels,
        "set_up": [setup_error.record() for setup_error in diagnosis.setup_errors],
        "implausible": diagnosis.implausible,
        "detection": {
            "statistic": test.statistic,
            "threshold": test.threshold,
            "dof": test.dof,
            "p_value": test.p_value,
            "noise": "stated" if known else "estimated",
            "chi2": test.chi2 if known else None,
            "chi2_p_value": test.chi2_p_value,
        },
        "noise_model": diagnosis.noise_words or None,
        "noise_rivals": {
            label: fault.alternative for label, fault in diagnosis.noise_wrong.items() if fault.alternative
        },
        "assumed_noise_p_value": diagnosis.assumed_p_value,
        "mountings": {label: {"rotation_deg": turn} for label, turn in diagnosis.mountings.items()} or None,
        "samples": None if diagnosis.samples is None else diagnosis.samples.record(),
        "sigma_g": diagnosis.sigma_g,
        "explanations": _explanations(diagnosis),
        "located": [located._asdict() for located in diagnosis.located],
        "unexplained": "; ".join(diagnosis.unexplained_terms) or None,
        "excess": None if diagnosis.unnamed is None else _excess(diagnosis.unnamed),
        "gain": diagnosis.gain,
        "shifts": shifts(diagnosis),
        "detection_limits": {
            id: {"limits": limit.coefficients, "unit": limit.unit, "visible_fraction": limit.visible_fraction}
            for id, limit in diagnosis.limits.items()
        },
        "invisible": diagnosis.invisible,
        "parameters": _parameters(diagnosis),
        "unseen": diagnosis.unseen,
        "not_testable": diagnosis.model.not_testable,
        "harmonics": diagnosis.harmonics,
        "predictive_checks": [vars(check) | {"outside": check.outside} for check in diagnosis.checks],
        "predictive_checks_after": [vars(check) | {"outside": check.outside} for check in diagnosis.checks_after],
    }


def shifts(diagnosis: Diagnosis) -> dict[str, dict[str, Any]]:
    """Change of each nominal parameter from the nominal fit to the calibration file, in display units and in the standard
    uncertainties of that file (`in_sd`)."""
    used, nominal, undetermined = diagnosis.in_use, diagnosis.nominal, diagnosis.extended.undetermined
    listed = {}
    for k, name in enumerate(nominal.names):
        if diagnosis.model.layout.of_positions[k]:
            continue
        unit, scale = shown(nominal.units[k])
        change = float(used.values[k] - nominal.values[k])
        listed[name] = {
            "shift": change * scale,
            "unit": unit,
            "in_sd": 0.0 if used.idle[k] else change / float(used.sd[k]),
            "determined": name not in undetermined and not used.idle[k],
        }
    return listed


def _parameters(diagnosis: Diagnosis) -> dict[str, dict[str, Any]]:
    """Each parameter that is not of one position, as calibration.json states it, base units: value, standard uncertainty `u`
    (None if no position in the fit depends on it) and its contributions, which add in quadrature."""
    used, model = diagnosis.in_use, diagnosis.model
    sd, parts = used.sd, used.parts
    return {
        name: {"value": used.values[k], "u": None if used.idle[k] else sd[k], "unit": model.units[k]}
        | {part: sizes[k] for part, sizes in parts.items()}
        for k, name in enumerate(model.names)
        if not model.layout.of_positions[k]
    }


def _explanations(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Those with the largest probabilities, the one acted on first."""
    of_data = dict.fromkeys(setup_error.label for setup_error in diagnosis.setup_errors)
    rows = [_explanation(diagnosis, one) for one in diagnosis.leading(_LEAST_PROBABLE, _MOST_EXPLANATIONS)]
    for row in rows:
        noise = (label for label in diagnosis.noise_labels if label not in row["effects"])
        row["effects"] = [*of_data, *noise, *row["effects"]]
    return sorted(rows, key=lambda row: not row["chosen"])


def _explanation(diagnosis: Diagnosis, explanation: Explanation) -> dict[str, Any]:
    chosen = explanation is diagnosis.best
    members = diagnosis.members if chosen else ()
    positions = dict[str, list[str]]()
    for id, _, names in (label.partition(":") for label in explanation.labels if ":" in label):
        positions.setdefault(id, []).extend(names.split("+"))
    listed = [one for cause in members for one in coefficients(diagnosis, cause)]
    return {
        "effects": [label.partition(":")[0] for label in explanation.labels],
        "positions": positions,
        "equivalents": _named(explanation.equivalents),
        "identical_at_1_g": _named(explanation.identical),
        "supersets": _named(explanation.supersets),
        "less_simple": _named(labels for labels, _ in explanation.less_probable),
        "probability": explanation.probability,
        "class_probability": explanation.class_probability,
        "chosen": chosen,
        "coefficients": {
            name: {"value": one.value, "sd": one.sd, "unit": one.unit, "determined": one.sd is not None}
            for one in listed
            for name in one.weights
            if len(one.weights) == 1
        },
        "combinations": [one for one in listed if len(one.weights) > 1],
        "temperature_orders": temperature_orders(members),
    }


def _named(sets: Iterable[tuple[str, ...]]) -> list[list[str]]:
    return [[label.replace(":", " at ", 1) for label in labels] for labels in sets]


def _excess(unnamed: Unnamed) -> dict[str, Any]:
    """Where an unexplained error is, and its candidate law; g, rad and the units stated."""
    excess = unnamed.excess
    return {
        "region": excess.region or None,
        "positions": [name for name, inside in zip(unnamed.fit.problem.names, excess.positions, strict=True) if inside],
        "ranges_g": {part.axis: [part.low, part.high] for part in excess.ranges},
        "law": None if unnamed.law is None else _law(unnamed.law),
    }


def _law(law: Law) -> dict[str, Any]:
    return {
        "terms": [
            {
                "acts_on": term.acts_on,
                "words": term.form.words,
                "coefficients": [1e3 * size for size in term.sizes],
                "u": [1e3 * sd for sd in term.sd],
                "unit": term.unit,
            }
            for term in law.terms
        ],
        "held_out_before_g": law.before_g,
        "held_out_after_g": law.after_g,
        "same_in_folds": law.same,
    }
