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
from tumblecal.lab.terms import term_of_form


# Directions of gravity at which readings are compared: faces, edges and corners of a cube.
DIRECTIONS = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float)
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1)[:, None]
# Probability within U for k = 2 and a normal distribution.
_INSIDE = 0.9545


def with_undetected(
    slope: Float[np.ndarray, "entries names"],
    covariance: Float[np.ndarray, "names names"],
    undetected: UndetectedEffects,
    model: FullModel,
    entries: Catalogue,
    where: Where,
    reference_degc: float | None,
) -> Float[np.ndarray, "entries entries"]:
    """The covariance of matrix, bias and terms for corrected readings.

    **Arguments:**

    - `slope`: of matrix, bias (`ORDER`) and terms by the parameters. `covariance`: of these, undetected effects included.
    - `undetected`: their shifts of the parameters, of the directions of `model`. `where`: settings of the data.
    - `reference_degc`: temperature for which the parameters are meant.
    """
    covariance = slope @ covariance @ slope.T
    ids, columns, terms = undetected.effects, list[int](), list[Term]()
    for slot in {slot.id: slot for slot in model.slots if slot.id in ids}.values():
        for form, column in zip(entries[slot.id].forms, slot.columns, strict=False):
            # At the time of the reference a drift is zero.
            if not form.get("per_hour"):
                thermal = "reference_degc" in form and reference_degc is not None
                stated = form | ({"reference_degc": reference_degc} if thermal else {})
                terms.append(term_of_form(stated, where, effect=slot.id))
                columns.append(column)
    if not len(undetected.steps):
        return covariance
    degc = None if where.temperature_degc is None else np.asarray(where.temperature_degc)
    inputs, signals = _signals(terms, degc)
    sizes = undetected.steps[:, columns] * model.scales[columns] * ~undetected.named[:, None]
    responses = np.tensordot(signals, sizes, (0, 1)).transpose(1, 0, 2)  # axis, point, direction
    regressors = np.column_stack([np.ones(len(inputs)), inputs])
    fitted = np.linalg.pinv(regressors) @ responses  # axis, (1, u), direction
    remainder, products = responses - regressors @ fitted, undetected.products
    moved = slope @ undetected.shifts
    corrected = moved.copy()
    # A reading is the inverse of the matrix times the force, and the bias: a slope takes from the matrix.
    corrected[:9] -= fitted[:, 1:].reshape(9, -1)
    corrected[9:12] += fitted[:, 0]
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
    inputs, signals = _signals(terms, temperature_degc)
    # f_r = sum_c matrix_rc (A_c - bias_c - terms_c): derivative by the row of the matrix, the bias, and the terms.
    of_matrix = np.kron(np.eye(3), inputs @ np.linalg.inv(matrix).T).reshape(3, len(inputs), 9).transpose(1, 0, 2)
    of_bias = np.broadcast_to(-matrix, (len(inputs), 3, 3))
    slope = np.concatenate([of_matrix, of_bias, -np.einsum("rc,kpc->prk", matrix, signals)], axis=2)
    variance = np.einsum("nrp,pq,nrq->nr", slope, covariance, slope)
    factor = float(stdtrit(min(max(dof, 1.0), 1e9), 0.5 + _INSIDE / 2))
    return factor * float(np.sqrt(np.max(variance)))


def _signals(
    terms: Sequence[Term], temperature_degc: Float[np.ndarray, " positions"] | None
) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "terms points 3"]]:
    """The directions of gravity at the lowest, mean and highest measured temperature, and the change of the readings there by
    one unit of each term's coefficient."""
    span = temperature_degc
    if span is not None:
        span = np.array([np.min(span), np.mean(span), np.max(span)])
    signals = contributions(terms, DIRECTIONS, span)
    inputs = np.tile(DIRECTIONS, (signals.shape[1], 1))
    return inputs, signals.reshape(len(terms), len(inputs), 3)
