"""`calibration.json` of the extended model."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tumblecal.data.calibration import Calibration
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.findings.decision import Weighed, is_thermal
from tumblecal.diagnosis.findings.determined import combinations, says_something
from tumblecal.effects.environment import REFERENCE_DEGC
from tumblecal.estimation.intrinsic import one_sensor
from tumblecal.report.result_file import linear_calibration
from tumblecal.report.sensor_terms import FittedEffect, SensorTerms, terms_of_chain


def extended_calibration(diagnosis: Diagnosis) -> Calibration | None:
    """The calibration with the nonlinear and thermal terms found, and those of the effects that the model was given with; None
    where there is none to write.

    Where several explanations are left, parameters and terms are averaged over them (`diagnosis.findings.decision`); they are
    meant for the middle of what was measured, with the covariance in use (`diagnosis.findings.in_use`). Effects of the head and
    of time change the estimates but are no property of the sensor: the file names them and holds no term for them.
    There is none to write for mixed-up axes or units (mend the data first), several sensors, or a fit that did not converge or
    says nothing of a parameter.
    """
    fit = diagnosis.extended
    if diagnosis.mix_ups or not (fit.code.good and says_something(fit)) or not one_sensor(fit):
        return None
    used, weighed = diagnosis.in_use.as_fit, diagnosis.in_use.weighed
    terms = terms_of_chain(used, diagnosis.model.nominal_chain, diagnosis.entries)
    given = terms.not_applied
    for own in weighed:
        _add_causes(terms, diagnosis, own)
    said = {"verdict": diagnosis.verdict, "causes": list(diagnosis.labels), "not_applied": terms.not_applied}
    if diagnosis.noise_words and not diagnosis.problem.known:
        said["stated_noise"] = f"The residuals contradict the assumed noise: {diagnosis.noise_words}"
    said["reference"] = _reference(diagnosis, given, thermal=terms.thermal)
    if len(weighed) > 1:
        said["averaged_over"] = [{"causes": list(own.labels), "probability": own.share} for own in weighed]
    calibration = linear_calibration(used)
    return terms.put_into(replace(calibration, provenance=calibration.provenance | said))


def _reference(diagnosis: Diagnosis, given: Sequence[str], *, thermal: bool) -> dict[str, float]:
    """The time (s) and temperature (degC) for which bias and scale factors are meant, where the data have such columns.

    **Arguments:**

    - `given`: effects of the model as it was given that the file cannot hold. Beside one that follows the time the bias holds
      where that counts from. `thermal`: whether the file has terms of temperature.
    """
    data, listed, entries = diagnosis.data, {}, diagnosis.entries
    # By several clocks there is no one time.
    one_clock = data.time_s is not None and data.clock is None
    if one_clock and not any("time_s" in entries[id].needs for id in given if id in entries):
        listed["time_s"] = float(np.mean(np.asarray(data.time_s)))
    if data.temperature_degc is not None:
        at_reference = thermal or is_thermal(diagnosis.members)
        listed["temperature_degc"] = REFERENCE_DEGC if at_reference else float(np.mean(data.temperature_degc))
    return listed


def _add_causes(terms: SensorTerms, diagnosis: Diagnosis, own: Weighed) -> None:
    """Add what one explanation names, by its share of the average."""
    for cause in own.members:
        if not cause.slot.columns:
            continue
        single = [c for c in combinations(own.fit, cause, diagnosis.model.scales) if len(c.weights) == 1]
        alone = {name for combination in single for name in combination.weights}
        effect = FittedEffect(cause.label, diagnosis.entries[cause.label].forms, cause.slot.names)
        terms.add(effect, own.fit, alone, own.share)
