"""Uncertainty of a corrected reading: parameters, terms, and effects of the sensor that the file does not contain.

An undetected effect without a term in the file is missing in every corrected reading: `phi(u, T) c`. It also changed the
fitted parameters, which compensates a part of it. Over all attitudes and the measured temperatures `phi` is split by least
squares into a part that matrix and bias can represent, which is added to the changes of the parameters, and a remainder, whose
mean square is added to the variance of the bias. The covariance is then valid for corrected readings.
"""

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Where
from tumblecal.data.calibration_terms import Term, contributions
from tumblecal.effects import Catalogue
from tumblecal.full_model.effect_directions import UndetectedEffects
from tumblecal.full_model.full_model import FullModel
from tumblecal.ground.axes import AXES
from tumblecal.lab.effect_forms import term_of_form
from tumblecal.lab.expanded_uncertainty import DIRECTIONS, spanned


def with_undetected(
    slope: Float[np.ndarray, "entries names"],
    covariance: Float[np.ndarray, "names names"],
    undetected: UndetectedEffects,
    responses: Float[np.ndarray, "directions points 3"],
) -> Float[np.ndarray, "entries entries"]:
    """The covariance of matrix, bias and terms for corrected readings.

    **Arguments:**

    - `slope`: of matrix, bias (`ORDER`) and terms by the parameters. `covariance`: of these, undetected effects included.
    - `undetected`: their shifts of the parameters. `responses`: as `responses` gives them.
    """
    covariance = slope @ covariance @ slope.T
    if not len(responses):
        return covariance
    inputs = np.tile(DIRECTIONS, (responses.shape[1] // len(DIRECTIONS), 1))
    regressors = np.column_stack([np.ones(len(inputs)), inputs])
    fitted = np.linalg.pinv(regressors) @ responses.transpose(2, 1, 0)  # axis, (1, u), direction
    remainder, products = responses.transpose(2, 1, 0) - regressors @ fitted, undetected.products
    moved = slope @ undetected.shifts
    corrected = moved.copy()
    for axis in range(len(AXES)):
        # A reading is the inverse of the matrix times the force, and the bias: a slope takes from the matrix.
        corrected[3 * axis : 3 * axis + 3] -= fitted[axis, 1:]
        corrected[9 + axis] += fitted[axis, 0]
    covariance = without_negative(covariance - moved @ products @ moved.T, covariance)
    covariance += corrected @ products @ corrected.T
    missed = np.einsum("kpi,kpi->k", remainder @ products, remainder) / len(inputs)
    covariance[np.arange(9, 12), np.arange(9, 12)] += missed
    return covariance


def without_negative(
    difference: Float[np.ndarray, "entries entries"], scale: Float[np.ndarray, "entries entries"]
) -> Float[np.ndarray, "entries entries"]:
    """A difference of covariances without negative variances: of an average over several explanations only the leading one's
    part of the effects is known."""
    sd = np.sqrt(np.maximum(np.diag(scale), 1e-300))
    variances, axes = np.linalg.eigh(difference / np.outer(sd, sd))
    root = sd[:, None] * axes * np.sqrt(np.maximum(variances, 0.0))
    return root @ root.T


def responses(
    undetected: UndetectedEffects,
    model: FullModel,
    entries: Catalogue,
    where: Where,
    reference_degc: float | None,
) -> Float[np.ndarray, "directions points 3"]:
    """Contribution of each direction of the undetected effects that a file could contain to the readings, at points of the
    sphere and of the temperature range, g; none without such effects.

    `reference_degc`: temperature for which the parameters are meant.
    """
    ids, columns, terms = undetected.effects, list[int](), list[Term]()
    for slot in {slot.id: slot for slot in model.slots if slot.id in ids}.values():
        for form, column in zip(entries[slot.id].forms, slot.columns, strict=False):
            # At the time of the reference a drift is zero.
            if not form.get("per_hour"):
                thermal = "reference_degc" in form and reference_degc is not None
                stated = form | ({"reference_degc": reference_degc} if thermal else {})
                terms.append(term_of_form(stated, where, effect=slot.id, determined=False))
                columns.append(column)
    span = spanned(None if where.temperature_degc is None else np.asarray(where.temperature_degc))
    points = len(DIRECTIONS) * (1 if span is None else len(span))
    signals = contributions(terms, DIRECTIONS, span).reshape(len(terms), points, 3)
    sizes = undetected.steps[:, columns] * model.scales[columns] * ~undetected.named[:, None]
    return np.tensordot(sizes, signals, 1)
