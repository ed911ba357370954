"""`calibration.json` of the extended model."""

from dataclasses import replace

import numpy as np

from tumblecal.data.calibration import Calibration
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.findings.decision import Weighed, is_thermal
from tumblecal.diagnosis.findings.determined import combinations, says_something
from tumblecal.effects.environment import REFERENCE_DEGC
from tumblecal.estimation.intrinsic import one_sensor
from tumblecal.report.result_file import calibration_of


def extended_calibration(diagnosis: Diagnosis) -> Calibration | None:
    """The calibration with the nonlinear and thermal terms found; None where there is none to write.

    Where several explanations are left, parameters and terms are averaged over them (`diagnosis.findings.decision`); they are
    meant for the middle of what was measured, with the covariance in use (`diagnosis.findings.in_use`). Effects of the head and
    of time change the estimates but are no property of the sensor: the file names them and holds no term for them.
    There is none to write for mixed-up axes or units (mend the data first), several sensors, or a fit that did not converge or
    says nothing of a parameter.
    """
    fit = diagnosis.extended
    if diagnosis.mix_ups or not (fit.code.good and says_something(fit)) or not one_sensor(fit):
        return None
    calibration, weighed = calibration_of(diagnosis.in_use.as_fit), diagnosis.in_use.weighed
    terms, left = _sensor_terms(diagnosis, weighed)
    extra = {"terms": terms, "terms_equation": "A = diag(1 + dK) u + bias + sum of coefficient * product of u^powers"}
    said = {"verdict": diagnosis.verdict, "causes": list(diagnosis.labels), "not_applied": left}
    said["reference"] = _reference(diagnosis)
    if len(weighed) > 1:
        said["averaged_over"] = [{"causes": list(own.labels), "probability": own.share} for own in weighed]
    return replace(calibration, provenance=calibration.provenance | said, extra=extra if terms else {})


def _reference(diagnosis: Diagnosis) -> dict[str, float]:
    """The time (s) and temperature (degC) for which bias and scale factors are meant, where the data have such columns."""
    data, listed = diagnosis.data, {}
    if data.time_s is not None:
        listed["time_s"] = float(np.mean(data.time_s))
    if data.temperature_degc is not None:
        listed["temperature_degc"] = (
            REFERENCE_DEGC if is_thermal(diagnosis.members) else float(np.mean(data.temperature_degc))
        )
    return listed


def _sensor_terms(diagnosis: Diagnosis, weighed: tuple[Weighed, ...]) -> tuple[list[dict], list[str]]:
    """The effects that belong to the sensor, as terms of a calibration file with their mean coefficients; and the ids that it
    cannot hold."""
    terms: dict[str, dict] = {}
    left: dict[str, None] = {}
    for own in weighed:
        for cause in own.members:
            if not cause.slot.columns:
                continue
            forms = diagnosis.entries[cause.label].forms
            if not forms:
                left[cause.label] = None
                continue
            single = [c for c in combinations(own.fit, cause, diagnosis.model.scales) if len(c.weights) == 1]
            alone = {name for combination in single for name in combination.weights}
            for form, name in zip(forms, cause.slot.names, strict=False):
                term = terms.setdefault(
                    name, {**form, "coefficient": 0.0, "determined": name in alone, "effect": cause.label}
                )
                term["coefficient"] += own.share * own.fit.value(name)
    return list(terms.values()), list(left)
