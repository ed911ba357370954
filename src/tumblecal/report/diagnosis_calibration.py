"""`calibration.json` of the extended model."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import ORDER, Calibration
from tumblecal.data.calibration_terms import Term
from tumblecal.data.calibration_use import Use
from tumblecal.data.sensor_parameters import SENSOR, leaf_of
from tumblecal.data.uncertainty_parts import PARTS, UNDETECTED
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.findings.decision import Weighed, is_thermal
from tumblecal.diagnosis.findings.determined import combinations
from tumblecal.diagnosis.findings.reference import moved_to_reference
from tumblecal.effects.effect import reason_not_held
from tumblecal.effects.environment import REFERENCE_DEGC
from tumblecal.estimation.fit import Fit
from tumblecal.report.diagnosis_use import not_written, use_of_diagnosis
from tumblecal.report.effect_forms import require_forms
from tumblecal.report.result_file import linear_calibration
from tumblecal.report.sensor_terms import FittedEffect, SensorTerms, Signal, lacking_words, terms_of_chain
from tumblecal.report.terms_covariance import WITH_TERMS, covariance_in_use


def extended_calibration(diagnosis: Diagnosis) -> Calibration | None:
    """The calibration with the nonlinear and thermal terms found, and those of the effects that the model was given with; None
    where there is none to write.

    If several explanations remain, parameters and terms are averaged over them (`diagnosis.findings.decision`). They refer to
    the mean time and temperature of the measurement, with the covariance in use (`diagnosis.findings.in_use`). Effects of the
    head and of time change the estimates but are no property of the sensor: the file lists them with reason and size, and
    contains no term for them.
    None is written if axes or units must be corrected first, for several sensors, or for a fit that did not converge or does
    not determine a parameter.
    """
    if not_written(diagnosis):
        return None
    used, weighed = diagnosis.in_use.as_fit, diagnosis.in_use.weighed
    given = _given_terms(diagnosis, used)
    of_model = [loss.effect for loss in given.not_applied]
    terms = _with_causes(given, diagnosis, _as_written(diagnosis))
    provenance = {"verdict": diagnosis.verdict, "causes": list(diagnosis.labels), "not_applied": []}
    if diagnosis.noise_words and not diagnosis.problem.known:
        provenance["stated_noise"] = f"The residuals contradict the assumed noise: {diagnosis.noise_words}"
    provenance |= {PARTS: _uncertainty_parts(diagnosis), UNDETECTED: _undetected(diagnosis)}
    provenance["reference"] = _reference(diagnosis, of_model, terms.listed)
    if len(weighed) > 1:
        provenance["averaged_over"] = [
            {"causes": list(explanation.labels), "probability": explanation.share} for explanation in weighed
        ]
    calibration = linear_calibration(used)
    estimated = terms.by_name if terms.by_name.keys() <= set(diagnosis.in_use.names) else {}
    covariance = covariance_in_use(diagnosis, estimated, provenance["reference"].get("temperature_degc"))
    alone, together = covariance[: len(ORDER), : len(ORDER)], {"order": [*ORDER, *estimated]}
    calibration = replace(
        calibration,
        covariance=alone,
        provenance=calibration.provenance | provenance,
        use=_use(diagnosis, terms, alone),
    )
    calibration = terms.put_into(calibration, diagnosis.data.temperature_degc)
    together |= {"covariance": covariance.tolist()}
    return replace(calibration, extra=calibration.extra | ({WITH_TERMS: together} if estimated else {}))


def diagnosed_use(diagnosis: Diagnosis) -> Use:
    """Whether the calibration of a diagnosis may be used, and why; `no` where none is written."""
    calibration = extended_calibration(diagnosis)
    if calibration is None:
        return Use("no", f"no calibration is written: {not_written(diagnosis)}")
    return calibration.use


def _use(diagnosis: Diagnosis, terms: SensorTerms, covariance: Float[np.ndarray, "12 12"]) -> Use:
    weighed = diagnosis.in_use.weighed
    each = [_by_explanation(diagnosis, explanation) for explanation in weighed] if len(weighed) > 1 else []
    return use_of_diagnosis(diagnosis, terms, covariance, each)


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
    calibration = extended_calibration(diagnosis)
    if calibration is not None:
        yield from lacking_words(calibration.not_applied, of_sensor=of_sensor)


def _uncertainty_parts(diagnosis: Diagnosis) -> dict[str, dict[str, float]]:
    """Contributions to the standard uncertainty of each parameter of sensor and mount, base units; they add in quadrature."""
    used = diagnosis.in_use
    places = {name: k for k, name in enumerate(used.names) if name in SENSOR or leaf_of(name) == "dtheta"}
    return {part: {name: float(sizes[k]) for name, k in places.items()} for part, sizes in used.parts.items()}


def _undetected(diagnosis: Diagnosis) -> list[str]:
    """Ids of the effects that the contribution of undetected effects is about."""
    undetected = diagnosis.in_use.undetected
    return [] if undetected is None else sorted(undetected.effects)


def _reference(diagnosis: Diagnosis, given: Sequence[str], terms: Sequence[Term]) -> dict[str, Any]:
    """The time (s) and temperature (degC) to which bias and scale factors refer, if the data have such columns.

    A linear drift has its mean at the mean time. With a bend, or a decay longer than the measurement, the parameters are means
    over the measurement, so the file states this time instead (`findings.reference`). A shorter decay is not included.

    **Arguments:**

    - `given`: effects of the given model that the file cannot contain. If one depends on time, the bias refers to the origin
      of that time. `terms`: of the file. If they have several reference temperatures, there is no single one.
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
        references = {term.reference_degc for term in terms if term.thermal}
        if not references:
            references = {REFERENCE_DEGC if is_thermal(diagnosis.members) else float(np.mean(data.temperature_degc))}
        if len(references) == 1:
            listed["temperature_degc"] = references.pop()
    return listed


def _as_written(diagnosis: Diagnosis) -> list[Weighed]:
    """The explanations with the written values: a missing coefficient counts as zero in the mean."""
    used = diagnosis.in_use
    values = [np.array([used.value(name) for name in explanation.fit.names]) for explanation in used.weighed]
    return [
        replace(explanation, fit=replace(explanation.fit, values=each))
        for explanation, each in zip(used.weighed, values, strict=True)
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
    added = moved_to_reference(diagnosis.screened.at, {cause.slot.id}, thermal=is_thermal(explanation.members))
    without = vector.copy()
    without[columns] = 0.0
    nominal = slice(model.nominal)
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
