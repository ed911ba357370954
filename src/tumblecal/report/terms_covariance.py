"""The covariance of matrix, bias and terms of a diagnosis' calibration together, for the uncertainty of corrected readings.

An undetected effect without a term in the file is missing in every corrected reading: `phi(u, T) c`. It also changed the
fitted parameters, which compensates a part of it. Over all attitudes and the measured temperatures `phi` is split by least
squares into a part that matrix and bias can represent, which is added to the changes of the parameters, and a remainder, whose
mean square is added to the variance of the bias. The covariance is then valid for corrected readings.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import ORDER
from tumblecal.data.calibration_terms import Term, contributions
from tumblecal.data.sensor_parameters import SENSOR, correction_slope
from tumblecal.diagnosis import Diagnosis
from tumblecal.report.calibration_limits import DIRECTIONS
from tumblecal.report.effect_forms import term_of_form


# The key of a file for it.
WITH_TERMS = "covariance_with_terms"


def covariance_in_use(
    diagnosis: Diagnosis, terms: Mapping[str, Term], reference_degc: float | None
) -> Float[np.ndarray, "entries entries"]:
    """The covariance of matrix and bias (the order of `ORDER`), then of the terms' coefficients, in the units of the file.

    `terms`: that were estimated, by the names of their coefficients. `reference_degc`: temperature for which the parameters are
    meant.
    """
    used, of_terms = diagnosis.in_use, [diagnosis.in_use.names.index(name) for name in terms]
    places, count = [used.names.index(name) for name in SENSOR], len(ORDER)
    slope = np.zeros((count + len(of_terms), len(used.names)))
    slope[:count, places] = correction_slope(used.values[places])
    # The model counts time in seconds.
    slope[count + np.arange(len(of_terms)), of_terms] = [3600.0 if term.per_hour else 1.0 for term in terms.values()]
    covariance, undetected = slope @ used.covariance @ slope.T, used.undetected
    responses = _responses(diagnosis, reference_degc)
    if not len(responses):
        return covariance
    inputs = np.tile(DIRECTIONS, (responses.shape[1] // len(DIRECTIONS), 1))
    regressors = np.column_stack([np.ones(len(inputs)), inputs])
    fitted = np.linalg.pinv(regressors) @ responses.transpose(2, 1, 0)  # axis, (1, u), direction
    remainder, products = responses.transpose(2, 1, 0) - regressors @ fitted, undetected.products
    moved = slope @ undetected.shifts
    whole = moved.copy()
    for axis in range(3):
        # A reading is the inverse of the matrix times the force, and the bias: a slope takes from the matrix.
        whole[3 * axis : 3 * axis + 3] -= fitted[axis, 1:]
        whole[9 + axis] += fitted[axis, 0]
    covariance = _without_negative(covariance - moved @ products @ moved.T, covariance) + whole @ products @ whole.T
    missed = np.einsum("kpi,kpi->k", remainder @ products, remainder) / len(inputs)
    covariance[np.arange(9, 12), np.arange(9, 12)] += missed
    return covariance


def _without_negative(
    difference: Float[np.ndarray, "entries entries"], scale: Float[np.ndarray, "entries entries"]
) -> Float[np.ndarray, "entries entries"]:
    """A difference of covariances without negative variances: of an average over several explanations only the leading one's
    part of the effects is known."""
    sd = np.sqrt(np.maximum(np.diag(scale), 1e-300))
    variances, axes = np.linalg.eigh(difference / np.outer(sd, sd))
    root = sd[:, None] * axes * np.sqrt(np.maximum(variances, 0.0))
    return root @ root.T


def _responses(diagnosis: Diagnosis, reference_degc: float | None) -> Float[np.ndarray, "directions points 3"]:
    """Contribution of each direction of the undetected effects that a file could contain to the readings, at points of the
    sphere and of the temperature range, g; none without such effects."""
    undetected, model = diagnosis.in_use.undetected, diagnosis.model
    degc, ids = diagnosis.data.temperature_degc, undetected.effects
    columns, terms = [], []
    for slot in {slot.id: slot for slot in model.slots if slot.id in ids}.values():
        for form, column in zip(diagnosis.entries[slot.id].forms, slot.columns, strict=False):
            # At the time of the reference a drift is zero.
            if not form.get("per_hour"):
                thermal = "reference_degc" in form and reference_degc is not None
                stated = form | ({"reference_degc": reference_degc} if thermal else {})
                terms.append(term_of_form(stated, diagnosis.problem.where, effect=slot.id, determined=False))
                columns.append(column)
    span = None if degc is None else np.array([np.min(degc), np.mean(degc), np.max(degc)])
    points = len(DIRECTIONS) * (1 if span is None else len(span))
    signals = contributions(terms, DIRECTIONS, span).reshape(len(terms), points, 3)
    sizes = undetected.steps[:, columns] * model.scales[columns] * ~undetected.named[:, None]
    return np.tensordot(sizes, signals, 1)
