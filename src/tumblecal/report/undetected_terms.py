"""Undetected effects of the sensor as an error of the linear correction, for the covariance of matrix and bias.

An effect that was not detected, and of which the file holds no term, is missing in every corrected reading: `phi(u, T) c`. It
moved the fitted parameters too, which makes up for a part of it. Over all attitudes and the measured temperatures, `phi` is
split into what matrix and bias can make (least squares), which is added to what the coefficient does to the parameters, and a
remainder, whose mean square counts as that of the bias. The covariance so holds for the readings that are corrected.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration_extended import values
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.diagnosis import Diagnosis
from tumblecal.estimation.intrinsic import correction_slope
from tumblecal.report.calibration_limits import DIRECTIONS
from tumblecal.report.effect_forms import per_hour, term_of_form


def added_by_undetected_terms(diagnosis: Diagnosis, reference_degc: float | None) -> Float[np.ndarray, "12 12"]:
    """What is added to the covariance of matrix and bias.

    **Arguments:**

    - `reference_degc`: temperature for which the parameters are meant.
    """
    used = diagnosis.in_use
    undetected, responses = used.undetected, _responses(diagnosis, reference_degc)
    if undetected is None or not len(responses):
        return np.zeros((12, 12))
    places = [used.names.index(name) for name in SENSOR]
    moved = correction_slope(used.values[places]) @ undetected.shifts[places]
    inputs = np.tile(DIRECTIONS, (responses.shape[1] // len(DIRECTIONS), 1))
    regressors = np.column_stack([np.ones(len(inputs)), inputs])
    fitted = np.linalg.pinv(regressors) @ responses.transpose(2, 1, 0)  # axis, (1, u), direction
    remainder = responses.transpose(2, 1, 0) - regressors @ fitted
    products = undetected.products
    whole = moved.copy()
    for axis in range(3):
        # A reading is the inverse of the matrix times the force, and the bias: a slope takes from the matrix.
        whole[3 * axis : 3 * axis + 3] -= fitted[axis, 1:]
        whole[9 + axis] += fitted[axis, 0]
    added = whole @ products @ whole.T - moved @ products @ moved.T
    missed = np.einsum("kpi,ij,kpj->k", remainder, products, remainder) / len(inputs)
    return added + np.diag([0.0] * 9 + missed.tolist())


def _responses(diagnosis: Diagnosis, reference_degc: float | None) -> Float[np.ndarray, "directions points 3"]:
    """What each direction of the undetected effects that a file could hold adds to the readings, at points of the sphere and
    of the temperature range, g; none without such effects."""
    undetected, model = diagnosis.in_use.undetected, diagnosis.model
    where, degc = diagnosis.problem.where, diagnosis.data.temperature_degc
    span = [None] if degc is None else [np.min(degc), np.mean(degc), np.max(degc)]
    responses = np.zeros((0 if undetected is None else len(undetected.numbers), len(span) * len(DIRECTIONS), 3))
    if undetected is None:
        return responses
    for slot in {slot.id: slot for slot in model.slots if slot.id in undetected.effects}.values():
        entry = diagnosis.entries[slot.id]
        for form, column, unit in zip(entry.forms, slot.columns, slot.units, strict=False):
            # At the time of the reference a drift is zero.
            if form.get("per_hour"):
                continue
            thermal = (
                {"reference_degc": reference_degc} if "reference_degc" in form and reference_degc is not None else {}
            )
            term = term_of_form(form | thermal, where, effect=slot.id, determined=False)
            size = float(model.scales[column]) * per_hour(term, unit)
            alone = [values([replace(term, coefficient=size)], DIRECTIONS, warm) for warm in span]
            responses += undetected.steps[:, column, None, None] * np.concatenate(alone)
    return responses * ~undetected.named[:, None, None]
