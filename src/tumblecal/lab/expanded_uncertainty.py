"""Expanded uncertainty of a corrected reading by the covariance of a calibration file."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.special import stdtrit

from tumblecal.data.calibration_terms import Term, contributions


# Directions of gravity at which readings are compared: faces, edges and corners of a cube.
DIRECTIONS = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float)
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1)[:, None]
# Probability within U for k = 2 and a normal distribution.
_INSIDE = 0.9545


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
