"""The use of the calibration of a diagnosis that its findings allow."""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_use import Use, combined
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.generic import UNEXPLAINED
from tumblecal.diagnosis.findings.determined import says_something
from tumblecal.estimation.intrinsic import one_sensor
from tumblecal.ground.errors import InputError
from tumblecal.report.calibration_judgements import MOST_MOVED_SD, MOST_TIMES_NOISE
from tumblecal.report.calibration_limits import DIRECTIONS, gravity_use, limits, undetermined_use
from tumblecal.report.cause_words import label_words
from tumblecal.report.sensor_terms import SensorTerms


# Held-out predictions are worse if their error increases by more than this many standard errors.
_WORSE_SD = 2.0


def not_written(diagnosis: Diagnosis) -> str:
    """Why a diagnosis writes no calibration; "" if it writes one."""
    fit = diagnosis.extended
    if diagnosis.setup_errors:
        labels = ", ".join(dict.fromkeys(error.label for error in diagnosis.setup_errors))
        return f"the data must be corrected first ({labels})"
    if not fit.code.good:
        return "the exact fit did not converge"
    if not says_something(fit):
        return "some parameters are not determined together with the causes found"
    return "" if one_sensor(fit) else "the model has no single sensor (dK, bias and gamma, one for all data)"


def use_of_diagnosis(
    diagnosis: Diagnosis,
    terms: SensorTerms,
    written: Float[np.ndarray, "12 12"] | None = None,
    explanations: Sequence[Calibration] = (),
) -> Use:
    """Whether the calibration of the extended model may be used.

    **Arguments:**

    - `terms`: of the file. `written`: as for `limits`. `explanations`: for an average over several, the calibration by each.
    """
    used = diagnosis.in_use.as_fit
    return combined([*_findings(diagnosis), *_disagreement(diagnosis, explanations), *limits(used, terms, written)])


def _findings(diagnosis: Diagnosis) -> Iterator[Use]:
    if diagnosis.implausible:
        yield Use("no", f"implausible values of {', '.join(one.parameter for one in diagnosis.implausible[:3])}")
    elif diagnosis.verdict == "unexplained":
        yield _unexplained(diagnosis, "the nominal model is rejected, and no catalogued effect explains the data")
    elif (
        UNEXPLAINED,
    ) in diagnosis.best.equivalents and 2 * diagnosis.best.own_probability < diagnosis.best.probability:
        named = label_words(diagnosis.best.labels)
        yield _unexplained(diagnosis, f"an effect that is not in the catalogue is more probable than {named}")
    yield from gravity_use(diagnosis.extended)
    yield from undetermined_use(diagnosis.in_use.as_fit)
    if diagnosis.members:
        gain = diagnosis.gain
        if gain.cv_rms_after_g - gain.cv_rms_before_g > _WORSE_SD * max(gain.cv_gain_sd_g, 0.0):
            yield Use("no", "with the causes found, held-out positions are predicted worse than without them")
    if diagnosis.noise_wrong:
        yield Use("yes", f"its uncertainties are those of the corrected noise ({', '.join(diagnosis.noise_wrong)})")


def _unexplained(diagnosis: Diagnosis, reason: str) -> Use:
    """An error that no catalogued effect explains, or probably none. The calibration is valid to about the largest error. It
    must not be used if the error or the residuals are many times the noise, or if the noise is unknown."""
    size = float(np.max(np.abs(diagnosis.extended.residuals[diagnosis.extended.retained])))
    small = diagnosis.problem.known and diagnosis.extended.level <= MOST_TIMES_NOISE
    if diagnosis.unnamed is not None:
        size = max(size, diagnosis.unnamed.excess.largest)
        small = small and size <= MOST_TIMES_NOISE * diagnosis.sigma_g
    return Use("yes" if small else "no", reason, size_g=size or None)


def _disagreement(diagnosis: Diagnosis, explanations: Sequence[Calibration]) -> Iterator[Use]:
    """Explanations that the data do not separate are averaged if their corrected readings agree, as for effects that are the
    same in a field of 1 g. Otherwise only the parameters in which they agree may be used."""
    if len(explanations) < 2:
        return
    fit, data = diagnosis.in_use.weighed[0].fit, diagnosis.data
    degc = None if data.temperature_degc is None else float(np.mean(data.temperature_degc))
    time_s = None if data.time_s is None else float(np.mean(data.time_s))
    try:
        forces = np.stack([each.corrected(DIRECTIONS, degc, time_s) for each in explanations])
    except InputError:
        yield Use("no", "the terms of one of the indistinguishable explanations cannot be inverted for readings of 1 g")
        return
    difference = float(np.max(np.abs(forces - forces[0])))
    if difference <= MOST_TIMES_NOISE * diagnosis.sigma_g:
        return
    values = np.array([each.sensor.of(SENSOR).values for each in explanations])
    places = [fit.names.index(name) for name in SENSOR]
    moved = np.max(np.abs(values - values[0]), axis=0) / np.maximum(fit.sd[places], 1e-300)
    names = tuple(name for name, change in zip(SENSOR, moved.tolist(), strict=True) if change <= MOST_MOVED_SD)
    reason = "the explanations that these data do not separate correct the readings differently"
    yield Use("only", reason, parameters=names, size_g=difference) if names else Use("no", reason, size_g=difference)
