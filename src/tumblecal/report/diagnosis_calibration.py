"""`calibration.json` of the extended model, and the use of it that the findings allow."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import ORDER, Calibration
from tumblecal.data.calibration_terms import WITH_TERMS, Term
from tumblecal.data.calibration_use import Use, combined
from tumblecal.data.sensor_parameters import SENSOR, correction_slope, leaf_of
from tumblecal.data.uncertainty_parts import PARTS, UNDETECTED
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause, label_words
from tumblecal.diagnosis.causes.generic import UNEXPLAINED
from tumblecal.diagnosis.findings.determined import combinations, says_something
from tumblecal.diagnosis.findings.model_average import Average, Weighed, is_thermal
from tumblecal.effects.effect import reason_not_held
from tumblecal.effects.environment import REFERENCE_DEGC
from tumblecal.estimation.contradicted import dof_of_readings
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.intrinsic import one_sensor, sensor_of
from tumblecal.estimation.linear_calibration import linear_calibration
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import p_words
from tumblecal.lab.corrected_reading import responses, with_undetected
from tumblecal.lab.effect_forms import require_forms
from tumblecal.lab.expanded_uncertainty import DIRECTIONS, expanded_uncertainty
from tumblecal.lab.limits import gravity_use, limits, systematic_g, undetermined_use
from tumblecal.lab.sensor_terms import FittedEffect, SensorTerms, Signal, lacking_words, terms_of_chain


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
    if not says_something(fit, diagnosis.model.nominal):
        return "some parameters are not determined together with the causes found"
    return "" if one_sensor(fit) else "the model has no single sensor (dK, bias and gamma, one for all data)"


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
    findings = [*_findings(diagnosis), *limits(diagnosis.data, terms)]
    known_g = systematic_g(diagnosis.data, terms)
    difference_g = _disagreement(diagnosis, explanations)
    if difference_g is None:
        reason = "the terms of one of the indistinguishable explanations cannot be inverted for readings of 1 g"
        findings.append(Use("no", reason))
    elif difference_g > 0:
        reason = "the explanations that these data do not separate correct the readings differently (U includes this)"
        findings.append(Use("yes", reason))
    return combined(findings, None if expanded_g is None else expanded_g + known_g + (difference_g or 0.0))


def _findings(diagnosis: Diagnosis) -> Iterator[Use]:
    detection = diagnosis.screened.detection
    if diagnosis.implausible:
        yield Use("no", f"implausible values of {', '.join(one.parameter for one in diagnosis.implausible[:3])}")
    elif diagnosis.verdict == "unexplained":
        rejected = f"the data contradict the model ({p_words(detection.p_value)})"
        yield Use("no", f"{rejected}, and no catalogued effect explains them")
    elif (
        UNEXPLAINED,
    ) in diagnosis.best.equivalents and 2 * diagnosis.best.own_probability < diagnosis.best.probability:
        named = label_words(diagnosis.best.labels)
        yield Use("no", f"an effect that is not in the catalogue is more probable than {named}")
    if dof_of_readings(diagnosis.extended) <= 0:
        yield Use("not tested", diagnosis.extended.no_freedom_words)
    yield from gravity_use(diagnosis.extended)
    yield from undetermined_use(diagnosis.in_use.as_fit)
    if diagnosis.members:
        gain = diagnosis.gain
        if gain.cv_rms_after_g - gain.cv_rms_before_g > _WORSE_SD * max(gain.cv_gain_sd_g, 0.0):
            yield Use("no", "with the causes found, held-out positions are predicted worse than without them")
    if diagnosis.noise_wrong:
        yield Use("yes", f"its uncertainties are those of the corrected noise ({', '.join(diagnosis.noise_wrong)})")


def _disagreement(diagnosis: Diagnosis, explanations: Sequence[Calibration]) -> float | None:
    """The largest difference of corrected readings between explanations that the data do not separate, g; None if the terms of
    one cannot be inverted. Effects that are the same in a field of 1 g agree."""
    if len(explanations) < 2:
        return 0.0
    data = diagnosis.data
    degc = None if data.temperature_degc is None else float(np.mean(data.temperature_degc))
    time_s = None if data.time_s is None else float(np.mean(data.time_s))
    try:
        forces = np.stack([each.corrected(DIRECTIONS, degc, time_s) for each in explanations])
    except InputError:
        return None
    difference = float(np.max(np.abs(forces - forces[0])))
    return difference if difference > diagnosis.sigma_g else 0.0


def extended_calibration(diagnosis: Diagnosis) -> Calibration | None:
    """The calibration with the nonlinear and thermal terms found, and those of the effects that the model was given with; None
    where there is none to write.

    If several explanations remain, parameters and terms are averaged over them (`diagnosis.findings.model_average`). They
    refer to the mean time and temperature of the measurement, with the covariance in use (`diagnosis.findings.in_use`).
    Effects of the head and of time change the estimates but are no property of the sensor: the file lists them with reason and
    size, and contains no term for them.
    None is written if axes or units must be corrected first, for several sensors, or for a fit that did not converge or does
    not determine a parameter.
    """
    if not_written(diagnosis):
        return None
    average = diagnosis.in_use
    used, weighed, degc = average.as_fit, average.weighed, diagnosis.data.temperature_degc
    given = _given_terms(diagnosis, used)
    of_model = [loss.effect for loss in given.not_applied]
    terms = _with_causes(given, diagnosis, _as_written(diagnosis))
    provenance = {"verdict": diagnosis.verdict, "causes": list(diagnosis.labels), "not_applied": []}
    if diagnosis.noise_words and not diagnosis.problem.known:
        provenance["stated_noise"] = f"The residuals contradict the assumed noise: {diagnosis.noise_words}"
    provenance |= {PARTS: _uncertainty_parts(diagnosis), UNDETECTED: sorted(diagnosis.in_use.undetected.effects)}
    provenance["reference"] = _reference(diagnosis, of_model, terms)
    several = weighed if len(weighed) > 1 else ()
    if several:
        provenance["averaged_over"] = [{"causes": list(one.labels), "probability": one.share} for one in several]
    each = [_by_explanation(diagnosis, one) for one in several]
    calibration = linear_calibration(used)
    estimated = terms.by_name if terms.by_name.keys() <= set(average.names) else {}
    reference_degc = provenance["reference"].get("temperature_degc")
    missed = responses(average.undetected, diagnosis.model, diagnosis.entries, diagnosis.problem.where, reference_degc)
    slope = _file_slope(average, estimated)
    covariance = with_undetected(slope, average.covariance, average.undetected, missed)
    dof = np.inf if diagnosis.problem.known else float(used.dof)
    expanded_g = expanded_uncertainty(
        calibration.matrix, covariance, terms=list(estimated.values()), temperature_degc=degc, dof=dof
    )
    alone, together = covariance[: len(ORDER), : len(ORDER)], {"order": [*ORDER, *estimated]}
    calibration = replace(
        calibration,
        covariance=alone,
        provenance=calibration.provenance | provenance,
        use=use_of_diagnosis(diagnosis, terms, expanded_g, each),
    )
    calibration = terms.put_into(calibration, degc)
    together |= {"covariance": covariance.tolist()}
    return replace(calibration, extra=calibration.extra | ({WITH_TERMS: together} if estimated else {}))


def _file_slope(average: Average, terms: Mapping[str, Term]) -> Float[np.ndarray, "entries names"]:
    """Derivative of matrix, bias (`ORDER`) and terms, in the units of the file, by the parameters."""
    count, of_terms = len(ORDER), [average.names.index(name) for name in terms]
    slope = np.zeros((count + len(of_terms), len(average.names)))
    # A fixed parameter has no column.
    estimated = np.array(SENSOR)[:, None] == np.array(average.names)
    slope[:count] = correction_slope(sensor_of(average.as_fit).values) @ estimated
    # The model counts time in seconds.
    slope[count + np.arange(len(of_terms)), of_terms] = [3600.0 if term.per_hour else 1.0 for term in terms.values()]
    return slope


def diagnosed_use(diagnosis: Diagnosis) -> Use:
    """Whether the calibration of a diagnosis may be used, and why; `no` where none is written."""
    if diagnosis.calibration is None:
        return Use("no", f"no calibration is written: {not_written(diagnosis)}")
    return diagnosis.calibration.use


def _given_terms(diagnosis: Diagnosis, fit: Fit) -> SensorTerms:
    """The terms of the effects of the given model."""
    given = partial(_given_signal, diagnosis)
    return terms_of_chain(fit, diagnosis.model.nominal_chain, diagnosis.entries, given)


def _by_explanation(diagnosis: Diagnosis, explanation: Weighed) -> Calibration:
    """The calibration by one of several explanations."""
    terms = _with_causes(_given_terms(diagnosis, explanation.fit), diagnosis, [explanation])
    return terms.put_into(linear_calibration(explanation.fit), diagnosis.data.temperature_degc)


def lacking_of_diagnosis(diagnosis: Diagnosis, *, of_sensor: bool = False) -> Iterator[str]:
    """Effects that calibration.json does not contain, with reasons and sizes; `of_sensor` as for `lacking_words`."""
    if diagnosis.calibration is not None:
        yield from lacking_words(diagnosis.calibration.not_applied, of_sensor=of_sensor)


def _uncertainty_parts(diagnosis: Diagnosis) -> dict[str, dict[str, float]]:
    """Contributions to the standard uncertainty of each parameter of sensor and mount, base units; they add in quadrature."""
    used = diagnosis.in_use
    places = {name: k for k, name in enumerate(used.names) if name in SENSOR or leaf_of(name) == "dtheta"}
    return {part: {name: float(sizes[k]) for name, k in places.items()} for part, sizes in used.parts.items()}


def _reference(diagnosis: Diagnosis, given: Sequence[str], terms: SensorTerms) -> dict[str, Any]:
    """The time (s) and temperature (degC) to which bias and scale factors refer, if the data have such columns.

    A linear drift has its mean at the mean time. With a bend, or a decay longer than the measurement, the parameters are means
    over the measurement, so the file states this time instead (`findings.reference`). A shorter decay is not included.

    `given`: effects of the given model that the file cannot contain. If one depends on time, the bias refers to the origin of
    that time. `terms`: of the file. If they have several reference temperatures, there is no single one.
    """
    data, entries = diagnosis.data, diagnosis.entries
    listed: dict[str, Any] = {}
    # Several clocks have no common time.
    one_clock = data.time_s is not None and data.clock is None
    if one_clock and not any("time_s" in entries[id].needs for id in given if id in entries):
        time, bends, decayed = np.asarray(data.time_s), False, set[str]()
        for explanation in diagnosis.in_use.weighed:
            for slot in (cause.slot for cause in explanation.members if "time_s" in cause.slot.needs):
                names = zip(slot.all_columns, slot.names, strict=True)
                constants = [explanation.fit.value(name) for column, name in names if column in slot.shape]
                long = all(constant > np.ptp(time) for constant in constants)
                bends |= slot.order > 1 or (bool(constants) and long)
                decayed |= {slot.id} if constants and not long else set()
        listed |= {"mean_over_s": [float(time.min()), float(time.max())]} if bends else {"time_s": float(np.mean(time))}
        listed |= {"without": sorted(decayed)} if decayed else {}
    if data.temperature_degc is not None:
        references = {term.reference_degc for term in terms.listed if term.thermal}
        if terms.curves is not None:
            references = {terms.curves.reference_degc}
        elif not references:
            references = {REFERENCE_DEGC if is_thermal(diagnosis.members) else float(np.mean(data.temperature_degc))}
        if len(references) == 1:
            listed["temperature_degc"] = references.pop()
    return listed


def _as_written(diagnosis: Diagnosis) -> list[Weighed]:
    """The explanations with the written values: a missing coefficient counts as zero in the mean."""
    used = diagnosis.in_use
    return [
        replace(one, fit=replace(one.fit, values=np.array([used.value(name) for name in one.fit.names])))
        for one in used.weighed
    ]


def _with_causes(terms: SensorTerms, diagnosis: Diagnosis, weighed: Sequence[Weighed]) -> SensorTerms:
    """The terms with those of the causes of each explanation, by the coefficients of its fit; each effect once."""
    for explanation, cause in [(one, member) for one in weighed for member in one.members]:
        if not cause.slot.columns or terms.has(cause.label):
            continue
        single = [c for c in combinations(explanation.fit, cause, diagnosis.model.scales) if len(c.weights) == 1]
        alone = {name for combination in single for name in combination.weights}
        entry = diagnosis.entries[cause.label]
        require_forms(entry)
        reason = reason_not_held(entry, cause.slot.links)
        effect = FittedEffect(cause.label, entry.forms, cause.slot.names, reason=reason)
        terms.add(effect, explanation.fit, alone, None if effect.held else _signal(diagnosis, explanation, cause))
    return terms


def _signal(diagnosis: Diagnosis, explanation: Weighed, cause: Cause) -> Signal:
    """Contribution of a cause to the readings, less the part that bias and scale factors at the reference absorb, g."""
    model, vector, columns = diagnosis.model, explanation.fit.vector.copy(), list(cause.slot.columns)
    vector[cause.slot.all_columns] = [explanation.fit.value(name) for name in cause.slot.names]
    without, nominal, added = vector.copy(), slice(model.nominal), diagnosis.in_use.to_reference
    without[columns] = 0.0
    taken_up = added[:, columns] @ (vector[columns] / model.scales[columns])
    without[nominal] += model.scales[nominal] * taken_up
    where = diagnosis.problem.where
    return model.predict(where, vector) - model.predict(where, without)


def _given_signal(diagnosis: Diagnosis, effect: FittedEffect) -> Signal:
    """Contribution of an effect of the given model to the readings, g; None for one that is not estimated."""
    model, vector = diagnosis.model, diagnosis.extended.vector
    units = dict(zip(model.names, model.units, strict=True))
    columns = [model.names.index(name) for name in effect.names if units.get(name, "s") != "s"]
    if not columns:
        return None
    without = vector.copy()
    without[columns] = 0.0
    return model.predict(diagnosis.problem.where, vector) - model.predict(diagnosis.problem.where, without)
