"""`calibration.json` of the extended model."""

from dataclasses import replace
from pathlib import Path

from tumblecal.data.calibration import write_calibration
from tumblecal.diagnosis.as_result import extended_result, sensor_terms
from tumblecal.diagnosis.diagnose import Diagnosis
from tumblecal.estimation.intrinsic import one_sensor
from tumblecal.report.result_file import calibration_of


def write_extended_calibration(folder: Path, found: Diagnosis) -> bool:
    """Write `calibration.json` with the nonlinear and thermal terms found; returns whether there is one to write.

    Effects of the head and of time change the estimates but are no property of the sensor: the file names them and
    holds no term for them. There is none to write for mixed-up axes or units (mend the data first), several sensors,
    or a fit that did not converge.
    """
    result = extended_result(found)
    if found.mix_ups or not result.code.good or not one_sensor(result):
        return False
    calibration = calibration_of(result)
    terms, left = sensor_terms(found)
    extra = {"terms": terms, "terms_equation": "A = diag(1 + dK) u + bias + sum of coefficient * product of u^powers"}
    said = {"verdict": found.verdict, "causes": list(found.labels), "not_applied": left}
    calibration = replace(calibration, provenance=calibration.provenance | said, extra=extra if terms else {})
    write_calibration(folder / "calibration.json", calibration)
    return True
