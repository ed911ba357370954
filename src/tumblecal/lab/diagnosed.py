"""`calibration.json` of a diagnosis: the extended model at one reference, with one stated uncertainty."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import ORDER, Calibration, write_calibration
from tumblecal.data.calibration_terms import WITH_TERMS
from tumblecal.data.calibration_use import Use
from tumblecal.data.sensor_parameters import SENSOR, correction_slope, leaf_of
from tumblecal.data.uncertainty_parts import PARTS, UNDETECTED
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.findings.determined import combinations, says_something
from tumblecal.diagnosis.findings.model_average import Weighed, is_thermal
from tumblecal.effects.effect import reason_not_held
from tumblecal.effects.environment import REFERENCE_DEGC
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.intrinsic import one_sensor, sensor_of
from tumblecal.estimation.linear_calibration import linear_calibration
from tumblecal.ground.errors import InputError
from tumblecal.lab.corrected_reading import expanded_uncertainty, with_undetected
from tumblecal.lab.terms import FittedEffect, SensorTerms, Signal, require_forms, terms_of_chain
from tumblecal.lab.use import use_of_diagnosis


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
    used, undetected = average.as_fit, average.undetected
    # With the written values: a missing coefficient counts as zero in the mean.
    written = [
        replace(one, fit=replace(one.fit, values=np.array([average.value(name) for name in one.fit.names])))
        for one in average.weighed
    ]
    terms = _terms(diagnosis, used, written)
    reference = _reference(diagnosis, terms)
    estimated = terms.by_name if terms.by_name.keys() <= {*average.names} else {}
    # Derivative of matrix, bias (`ORDER`) and terms, in the units of the file, by the parameters. A fixed parameter has no
    # column, and the model counts time in seconds.
    sensor, of_terms = (np.array(names, str)[:, None] == np.array(average.names) for names in (SENSOR, [*estimated]))
    scales = np.array([3600.0 if term.per_hour else 1.0 for term in estimated.values()])
    slope = np.vstack([correction_slope(sensor_of(used).values) @ sensor, scales[:, None] * of_terms])
    where, at_degc = diagnosis.problem.where, reference.get("temperature_degc")
    covariance = with_undetected(
        slope, average.covariance, undetected, diagnosis.model, diagnosis.entries, where, at_degc
    )
    linear = linear_calibration(used)
    expanded_g = expanded_uncertainty(
        linear.matrix,
        covariance,
        terms=[*estimated.values()],
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
        UNDETECTED: sorted(undetected.effects),
        "reference": reference,
    }
    if diagnosis.noise_words and not known:
        provenance["stated_noise"] = f"The residuals contradict the assumed noise: {diagnosis.noise_words}"
    if several:
        provenance["averaged_over"] = [{"causes": list(one.labels), "probability": one.share} for one in several]
    calibration = replace(
        linear,
        covariance=covariance[: len(ORDER), : len(ORDER)],
        provenance=linear.provenance | provenance,
        use=use_of_diagnosis(diagnosis, terms, expanded_g, each),
    )
    calibration = terms.put_into(calibration, degc)
    if not estimated:
        return calibration
    together = {"order": [*ORDER, *estimated], "covariance": covariance.tolist()}
    return replace(calibration, extra=calibration.extra | {WITH_TERMS: together})


def _reference(diagnosis: Diagnosis, terms: SensorTerms) -> dict[str, Any]:
    """The time (s) and temperature (degC) to which bias and scale factors refer, if the data have such columns.

    A linear drift has its mean at the mean time. With a bend, or a decay longer than the measurement, the parameters are means
    over the measurement, so the file states this time instead (`full_model.reference`). A shorter decay is not included. If an
    effect of the given model that the file cannot contain depends on time, the bias refers to the origin of that time. If the
    terms have several reference temperatures, there is no single one.
    """
    data, entries, reference = diagnosis.data, diagnosis.entries, dict[str, Any]()
    causes = [(one.fit, cause) for one in diagnosis.in_use.weighed for cause in one.members]
    given = terms.lacking.keys() - {cause.label for _, cause in causes}
    # Several clocks have no common time.
    one_clock = data.time_s is not None and data.clock is None
    if one_clock and not any("time_s" in entries[id].needs for id in given if id in entries):
        time, bends, decayed = np.asarray(data.time_s), False, set[str]()
        for fit, slot in [(fit, cause.slot) for fit, cause in causes if "time_s" in cause.slot.needs]:
            names = [name for column, name in zip(slot.all_columns, slot.names, strict=True) if column in slot.shape]
            if any(fit.value(name) <= np.ptp(time) for name in names):
                decayed.add(slot.id)
                names = []
            bends |= slot.order > 1 or bool(names)
        stated = {"mean_over_s": [float(time.min()), float(time.max())]} if bends else {"time_s": float(time.mean())}
        reference |= stated | ({"without": sorted(decayed)} if decayed else {})
    if data.temperature_degc is not None:
        references = {term.reference_degc for term in terms.by_name.values() if term.thermal}
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
