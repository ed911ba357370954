"""`calibration.json` of the extended model."""

from dataclasses import replace

from tumblecal.data.calibration import Calibration
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.findings.decision import Weighed, averaged
from tumblecal.diagnosis.findings.determined import combinations, says_something
from tumblecal.estimation.intrinsic import one_sensor
from tumblecal.report.result_file import calibration_of


def extended_calibration(diagnosis: Diagnosis) -> Calibration | None:
    """The calibration with the nonlinear and thermal terms found; None where there is none to write.

    Where several explanations are left, parameters and terms are averaged over them (`diagnosis.findings.decision`). Effects
    of the head and of time change the estimates but are no property of the sensor: the file names them and holds no term for
    them.
    There is none to write for mixed-up axes or units (mend the data first), several sensors, or a fit that did not converge or
    says nothing of a parameter.
    """
    fit, average = diagnosis.extended, None
    if diagnosis.mix_ups or not (fit.code.good and says_something(fit)) or not one_sensor(fit):
        return None
    if diagnosis.verdict == "ambiguous":
        average = averaged(diagnosis.screened, fit)
    calibration = calibration_of(fit if average is None else average.as_fit)
    weighed = (Weighed(diagnosis.best.labels, 1.0, diagnosis.members, fit),) if average is None else average.weighed
    terms, left = _sensor_terms(diagnosis, weighed)
    extra = {"terms": terms, "terms_equation": "A = diag(1 + dK) u + bias + sum of coefficient * product of u^powers"}
    said = {"verdict": diagnosis.verdict, "causes": list(diagnosis.labels), "not_applied": left}
    if average is not None:
        said["averaged_over"] = [{"causes": list(own.labels), "probability": own.share} for own in weighed]
    return replace(calibration, provenance=calibration.provenance | said, extra=extra if terms else {})


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
