"""Uncertainty of a corrected reading: parameters, terms, and effects of the sensor that the file does not contain.

An undetected effect without a term in the file is missing in every corrected reading: `phi(u, T) c`. It also changed the
fitted parameters, which compensates a part of it. Over all attitudes and the measured temperatures `phi` is split by least
squares into a part that matrix and bias can represent, which is added to the changes of the parameters, and a remainder, whose
mean square is added to the variance of the bias. The covariance is then valid for corrected readings.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.special import stdtrit

from tumblecal.chain import Where
from tumblecal.data.calibration_terms import Term, contributions
from tumblecal.effects import Catalogue
from tumblecal.full_model.effect_directions import UndetectedEffects
from tumblecal.full_model.full_model import FullModel
from tumblecal.ground.axes import AXES
from tumblecal.lab.effect_forms import term_of_form


# Directions of gravity at which readings are compared: faces, edges and corners of a cube.
DIRECTIONS = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float)
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1)[:, None]
# Probability within U for k = 2 and a normal distribution.
_INSIDE = 0.9545


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


def expanded_uncertainty(
    matrix: Float[np.ndarray, "3 3"],
    covariance: Float[np.ndarray, "entries entries"],
    *,
    terms: Sequence[Term] = (),
    temperature_degc: Float[np.ndarray, " positions"] | None = None,
    dof: float = np.inf,
) -> float:
    """U of each component of a corrected reading at 1 g, g: the largest over attitudes and measured temperatures.

    **Arguments:**

    - `covariance`: of matrix and bias (`ORDER`), then of the coefficients of `terms`, in the units of the file.
    - `dof`: degrees of freedom of an estimated noise: the factor is that of Student's t.
    """
    signals = contributions(terms, DIRECTIONS, spanned(temperature_degc))
    signals = signals.reshape(len(terms), signals.shape[1] * len(DIRECTIONS), 3)
    readings = np.tile(DIRECTIONS @ np.linalg.inv(matrix).T, (signals.shape[1] // len(DIRECTIONS), 1))
    # f_r = sum_c matrix_rc (A_c - bias_c - terms_c): derivative by the row of the matrix, the bias, and the terms.
    slope = np.zeros((len(readings), 3, len(covariance)))
    for row in range(3):
        slope[:, row, 3 * row : 3 * row + 3] = readings
    slope[:, :, 9:12] = -matrix
    slope[:, :, 12:] = -np.einsum("rc,kpc->prk", matrix, signals)
    variance = np.einsum("nrp,pq,nrq->nr", slope, covariance, slope)
    factor = float(stdtrit(min(max(dof, 1.0), 1e9), 0.5 + _INSIDE / 2))
    return factor * float(np.sqrt(np.max(variance)))


def spanned(temperature_degc: Float[np.ndarray, " positions"] | None) -> Float[np.ndarray, " 3"] | None:
    """Lowest, mean and highest measured temperature."""
    if temperature_degc is None:
        return None
    return np.array([np.min(temperature_degc), np.mean(temperature_degc), np.max(temperature_degc)])
