"""`calibration.json` of a diagnosis: the extended model at one reference, with one stated uncertainty."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import ORDER, Calibration
from tumblecal.data.calibration_terms import WITH_TERMS
from tumblecal.data.sensor_parameters import SENSOR, correction_slope, leaf_of
from tumblecal.data.uncertainty_parts import PARTS, UNDETECTED
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.findings.determined import combinations
from tumblecal.diagnosis.findings.model_average import Average, Weighed, is_thermal
from tumblecal.effects.effect import reason_not_held
from tumblecal.effects.environment import REFERENCE_DEGC
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.intrinsic import sensor_of
from tumblecal.estimation.linear_calibration import linear_calibration
from tumblecal.lab.corrected_reading import expanded_uncertainty, responses, with_undetected
from tumblecal.lab.diagnosed_use import not_written, use_of_diagnosis
from tumblecal.lab.effect_forms import require_forms
from tumblecal.lab.sensor_terms import FittedEffect, SensorTerms, Signal, terms_of_chain


def extended_calibration(diagnosis: Diagnosis) -> Calibration | None:
    """The calibration with the nonlinear and thermal terms found, and those of the effects of the given model; None if none can
    be written (`not_written`).

    If several explanations remain, parameters and terms are averaged over them (`diagnosis.findings.model_average`). They
    refer to the mean time and temperature of the measurement, with the covariance in use (`diagnosis.findings.in_use`).
    Effects of the head and of time change the estimates but are no property of the sensor: the file lists them with reason and
    size, and contains no term for them.
    """
    if not_written(diagnosis):
        return None
    average, degc, known = diagnosis.in_use, diagnosis.data.temperature_degc, diagnosis.problem.known
    used = average.as_fit
    terms = _terms(diagnosis, used, _as_written(average))
    reference = _reference(diagnosis, terms)
    estimated = terms.by_name if terms.by_name.keys() <= {*average.names} else {}
    at_degc = reference.get("temperature_degc")
    missed = responses(average.undetected, diagnosis.model, diagnosis.entries, diagnosis.problem.where, at_degc)
    # Derivative of matrix, bias (`ORDER`) and terms, in the units of the file, by the parameters. A fixed parameter has no
    # column, and the model counts time in seconds.
    sensor, of_terms = (np.array(names, str)[:, None] == np.array(average.names) for names in (SENSOR, [*estimated]))
    scales = np.array([3600.0 if term.per_hour else 1.0 for term in estimated.values()])
    slope = np.vstack([correction_slope(sensor_of(used).values) @ sensor, scales[:, None] * of_terms])
    covariance = with_undetected(slope, average.covariance, average.undetected, missed)
    linear = linear_calibration(used)
    expanded_g = expanded_uncertainty(
        linear.matrix,
        covariance,
        terms=list(estimated.values()),
        temperature_degc=degc,
        dof=np.inf if known else float(used.dof),
    )
    several = average.weighed if len(average.weighed) > 1 else ()
    each = [_terms(diagnosis, one.fit, [one]).put_into(linear_calibration(one.fit), degc) for one in several]
    of_sensor = {name: k for k, name in enumerate(average.names) if name in SENSOR or leaf_of(name) == "dtheta"}
    provenance: dict[str, Any] = {
        "verdict": diagnosis.verdict,
        "causes": list(diagnosis.labels),
        "not_applied": [],
        # Contributions to the standard uncertainty, base units; they add in quadrature.
        PARTS: {
            part: {name: float(sizes[k]) for name, k in of_sensor.items()} for part, sizes in average.parts.items()
        },
        UNDETECTED: sorted(average.undetected.effects),
        "reference": reference,
    }
    if diagnosis.noise_words and not known:
        provenance["stated_noise"] = f"The residuals contradict the assumed noise: {diagnosis.noise_words}"
    if several:
        provenance["averaged_over"] = [{"causes": list(one.labels), "probability": one.share} for one in several]
    calibration = terms.put_into(
        replace(
            linear,
            covariance=covariance[: len(ORDER), : len(ORDER)],
            provenance=linear.provenance | provenance,
            use=use_of_diagnosis(diagnosis, terms, expanded_g, each),
        ),
        degc,
    )
    if not estimated:
        return calibration
    together = {"order": [*ORDER, *estimated], "covariance": covariance.tolist()}
    return replace(calibration, extra=calibration.extra | {WITH_TERMS: together})


def _as_written(average: Average) -> list[Weighed]:
    """The explanations with the written values: a missing coefficient counts as zero in the mean."""
    return [
        replace(one, fit=replace(one.fit, values=np.array([average.value(name) for name in one.fit.names])))
        for one in average.weighed
    ]


def _reference(diagnosis: Diagnosis, terms: SensorTerms) -> dict[str, Any]:
    """The time (s) and temperature (degC) to which bias and scale factors refer, if the data have such columns.

    A linear drift has its mean at the mean time. With a bend, or a decay longer than the measurement, the parameters are means
    over the measurement, so the file states this time instead (`full_model.reference`). A shorter decay is not included. If an
    effect of the given model that the file cannot contain depends on time, the bias refers to the origin of that time. If the
    terms have several reference temperatures, there is no single one.
    """
    data, entries, reference = diagnosis.data, diagnosis.entries, dict[str, Any]()
    explanations = diagnosis.in_use.weighed
    found = {cause.label for one in explanations for cause in one.members}
    given = {loss.effect for loss in terms.not_applied} - found
    # Several clocks have no common time.
    one_clock = data.time_s is not None and data.clock is None
    if one_clock and not any("time_s" in entries[id].needs for id in given if id in entries):
        time = np.asarray(data.time_s)
        timed = [(cause.slot, one.fit) for one in explanations for cause in one.members if "time_s" in cause.slot.needs]
        bends, decayed = False, set[str]()
        for slot, fit in timed:
            names = [name for column, name in zip(slot.all_columns, slot.names, strict=True) if column in slot.shape]
            short = any(fit.value(name) <= np.ptp(time) for name in names)
            bends |= slot.order > 1 or (bool(names) and not short)
            decayed |= {slot.id} if short else set()
        reference |= (
            {"mean_over_s": [float(time.min()), float(time.max())]} if bends else {"time_s": float(time.mean())}
        )
        reference |= {"without": sorted(decayed)} if decayed else {}
    if data.temperature_degc is not None:
        references = {term.reference_degc for term in terms.listed if term.thermal}
        if terms.curves is not None:
            references = {terms.curves.reference_degc}
        elif not references:
            references = {REFERENCE_DEGC if is_thermal(diagnosis.members) else float(np.mean(data.temperature_degc))}
        if len(references) == 1:
            reference["temperature_degc"] = references.pop()
    return reference


def _terms(diagnosis: Diagnosis, fit: Fit, weighed: Sequence[Weighed]) -> SensorTerms:
    """The terms of the effects of the given model, at the values of a fit, and of the causes of each explanation, at the values
    of its fit; each effect once."""
    model, entries = diagnosis.model, diagnosis.entries
    units = dict(zip(model.names, model.units, strict=True))

    def given(effect: FittedEffect) -> Signal:
        columns = [model.names.index(name) for name in effect.names if units.get(name, "s") != "s"]
        return _signal(diagnosis, diagnosis.extended.vector, columns) if columns else None

    terms = terms_of_chain(fit, model.nominal_chain, entries, given)
    for fitted, cause in [(one.fit, cause) for one in weighed for cause in one.members]:
        slot = cause.slot
        if not slot.columns or terms.has(cause.label):
            continue
        require_forms(entry := entries[cause.label])
        determined = [one.weights for one in combinations(fitted, cause, model.scales) if len(one.weights) == 1]
        effect = FittedEffect(entry.id, entry.forms, slot.names, reason=reason_not_held(entry, slot.links))
        vector = fitted.vector.copy()
        vector[slot.all_columns] = [fitted.value(name) for name in slot.names]
        signal = None if effect.held else _signal(diagnosis, vector, list(slot.columns))
        terms.add(effect, fitted, {name for weights in determined for name in weights}, signal)
    return terms


def _signal(diagnosis: Diagnosis, vector: Float[np.ndarray, " full"], columns: list[int]) -> Signal:
    """Contribution of some columns to the readings, less the part that bias and scale factors at the reference absorb, g."""
    model, where = diagnosis.model, diagnosis.problem.where
    without, nominal = vector.copy(), slice(model.nominal)
    without[columns] = 0.0
    absorbed = diagnosis.in_use.to_reference[:, columns] @ (vector[columns] / model.scales[columns])
    without[nominal] += model.scales[nominal] * absorbed
    return model.predict(where, vector) - model.predict(where, without)
