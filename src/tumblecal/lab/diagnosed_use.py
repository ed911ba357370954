"""Whether the calibration of a diagnosis may be used, and why none is written."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from tumblecal.data.calibration import Calibration, write_calibration
from tumblecal.data.calibration_use import Use, combined
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import UNEXPLAINED
from tumblecal.diagnosis.findings.determined import says_something
from tumblecal.estimation.contradicted import dof_of_readings
from tumblecal.estimation.intrinsic import one_sensor
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import p_words
from tumblecal.lab.corrected_reading import DIRECTIONS
from tumblecal.lab.limits import gravity_use, limits, systematic_g, undetermined_use
from tumblecal.lab.sensor_terms import SensorTerms, lacking_words


# Held-out predictions are worse if their error increases by more than this many standard errors.
_WORSE_SD = 2.0


def save_extended(path: Path, diagnosis: Diagnosis) -> None:
    """Write the `calibration.json` of the extended model.

    **Raises:** `InputError` if there is none, with the reason.
    """
    if diagnosis.calibration is None:
        raise InputError(f"{diagnosis.data.source}: no calibration to save: {not_written(diagnosis)}")
    write_calibration(path, diagnosis.calibration)


def not_written(diagnosis: Diagnosis) -> str:
    """Why a diagnosis writes no calibration; "" if it writes one."""
    fit = diagnosis.extended
    if diagnosis.setup_errors:
        labels = ", ".join(dict.fromkeys(error.label for error in diagnosis.setup_errors))
        return f"the data must be corrected first ({labels})"
    if not fit.code.good:
        return "the exact fit did not converge"
    if not says_something(fit, diagnosis.model.nominal):
        return "some parameters are not determined together with the causes found"
    return "" if one_sensor(fit) else "the model has no single sensor (dK, bias and gamma, one for all data)"


def diagnosed_use(diagnosis: Diagnosis) -> Use:
    """The use of the calibration of a diagnosis; `no` if none is written."""
    if diagnosis.calibration is None:
        return Use("no", f"no calibration is written: {not_written(diagnosis)}")
    return diagnosis.calibration.use


def lacking_of_diagnosis(diagnosis: Diagnosis) -> Iterator[str]:
    """Effects of the sensor that calibration.json does not contain, with reasons and sizes."""
    if diagnosis.calibration is not None:
        yield from lacking_words(diagnosis.calibration.not_applied, of_sensor=True)


def use_of_diagnosis(
    diagnosis: Diagnosis,
    terms: SensorTerms,
    expanded_g: float | None = None,
    explanations: Sequence[Calibration] = (),
) -> Use:
    """Whether the calibration of the extended model may be used.

    `terms`: of the file. `expanded_g`: U of a corrected reading without known systematic errors, g. `explanations`: for an
    average over several, the calibration by each.
    """
    data, difference_g = diagnosis.data, 0.0
    uses = [*_findings(diagnosis), *limits(data, terms)]
    means = [None if column is None else float(np.mean(column)) for column in (data.temperature_degc, data.time_s)]
    try:
        # Effects that are the same in a field of 1 g agree.
        forces = [each.corrected(DIRECTIONS, *means) for each in explanations]
        difference_g = max((float(np.max(np.abs(force - forces[0]))) for force in forces), default=0.0)
    except InputError:
        reason = "the terms of one of the indistinguishable explanations cannot be inverted for readings of 1 g"
        uses.append(Use("no", reason))
    if difference_g > diagnosis.sigma_g:
        reason = "the explanations that these data do not separate correct the readings differently (U includes this)"
        uses.append(Use("yes", reason))
    else:
        difference_g = 0.0
    return combined(uses, None if expanded_g is None else expanded_g + systematic_g(data, terms) + difference_g)


def _findings(diagnosis: Diagnosis) -> Iterator[Use]:
    """The uses that the findings allow."""
    best, gain = diagnosis.best, diagnosis.gain if diagnosis.members else None
    if diagnosis.implausible:
        yield Use("no", f"implausible values of {', '.join(one.parameter for one in diagnosis.implausible[:3])}")
    elif diagnosis.verdict == "unexplained":
        p_value = p_words(diagnosis.screened.detection.p_value)
        yield Use("no", f"the data contradict the model ({p_value}), and no catalogued effect explains them")
    elif (UNEXPLAINED,) in best.equivalents and 2 * best.own_probability < best.probability:
        yield Use("no", f"an effect that is not in the catalogue is more probable than {' + '.join(best.labels)}")
    if dof_of_readings(diagnosis.extended) <= 0:
        yield Use("not tested", diagnosis.extended.no_freedom_words)
    yield from gravity_use(diagnosis.extended)
    yield from undetermined_use(diagnosis.in_use.as_fit)
    if gain and gain.cv_rms_after_g - gain.cv_rms_before_g > _WORSE_SD * max(gain.cv_gain_sd_g, 0.0):
        yield Use("no", "with the causes found, held-out positions are predicted worse than without them")
    if diagnosis.noise_wrong:
        yield Use("yes", f"its uncertainties are those of the corrected noise ({', '.join(diagnosis.noise_wrong)})")
