"""`calibration.json` of the extended model."""

from dataclasses import replace
from pathlib import Path

from tumblecal.data.calibration import Calibration, write_calibration
from tumblecal.diagnosis import Diagnosis
from tumblecal.estimation.intrinsic import one_sensor
from tumblecal.report.diagnosis_words import coefficients
from tumblecal.report.result_file import calibration_of


def write_extended_calibration(folder: Path, diagnosis: Diagnosis) -> bool:
    """Write `calibration.json`; returns whether there is one to write."""
    calibration = extended_calibration(diagnosis)
    if calibration is not None:
        write_calibration(folder / "calibration.json", calibration)
    return calibration is not None


def extended_calibration(diagnosis: Diagnosis) -> Calibration | None:
    """The calibration with the nonlinear and thermal terms found; None where there is none to write.

    Effects of the head and of time change the estimates but are no property of the sensor: the file names them and
    holds no term for them. There is none to write for mixed-up axes or units (mend the data first), several sensors,
    or a fit that did not converge.
    """
    fit = diagnosis.extended
    if diagnosis.mix_ups or not fit.code.good or not one_sensor(fit):
        return None
    calibration = calibration_of(fit)
    terms, left = _sensor_terms(diagnosis)
    extra = {"terms": terms, "terms_equation": "A = diag(1 + dK) u + bias + sum of coefficient * product of u^powers"}
    said = {"verdict": diagnosis.verdict, "causes": list(diagnosis.labels), "not_applied": left}
    return replace(calibration, provenance=calibration.provenance | said, extra=extra if terms else {})


def _sensor_terms(diagnosis: Diagnosis) -> tuple[list[dict], list[str]]:
    """The effects found that belong to the sensor, as terms of a calibration file; and the ids that it cannot hold."""
    terms, left = [], []
    for cause in diagnosis.members:
        if not cause.slot.columns:
            continue
        forms = diagnosis.entries[cause.label].forms
        if not forms:
            left.append(cause.label)
        for form, (name, said) in zip(forms, coefficients(diagnosis, cause).items(), strict=False):
            size = {"coefficient": diagnosis.extended.value(name), "determined": said["determined"]}
            terms.append({**form, **size, "effect": cause.label})
    return terms, left
