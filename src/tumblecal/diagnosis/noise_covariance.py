"""Covariances of the weighted rows in the form that suits them, and rows made white by them.

A covariance is given as a diagonal (rows), as a matrix between positions that is the same for the three axes (positions,
positions), as a block for each position (positions, 3, 3), or as a full matrix (rows, rows); rows are positions times
axes, the axis running fastest. Priors' rows, which may follow, have variance one and are left alone.
"""

import numpy as np
from jaxtyping import Float


def root_of(covariance: np.ndarray) -> np.ndarray:
    """Square root of a covariance, in its own form: standard deviations, or lower triangles."""
    return np.sqrt(covariance) if covariance.ndim == 1 else np.linalg.cholesky(covariance)


def whitened(
    root: np.ndarray, count: int, rows: Float[np.ndarray, "rows columns"]
) -> Float[np.ndarray, "rows columns"]:
    """Rows of which the noise is white, from those with a covariance; `count` of them are readings."""
    readings, columns = rows[:count], rows.shape[1]
    if root.ndim == 1:
        white = readings / root[:, None]
    elif root.ndim == 3:
        white = np.linalg.solve(root, readings.reshape(count // 3, 3, columns)).reshape(count, columns)
    else:
        white = np.linalg.solve(root, readings.reshape(len(root), count * columns // len(root))).reshape(count, columns)
    return white if count == len(rows) else np.concatenate([white, rows[count:]])


def half_log_det(root: np.ndarray, count: int) -> float:
    """Half the logarithm of the covariance's determinant."""
    if root.ndim == 1:
        return float(np.sum(np.log(root)))
    diagonal = np.log(np.diagonal(root, axis1=-2, axis2=-1))
    return float(np.sum(diagonal)) * (3 if root.ndim == 2 and len(root) < count else 1)


def as_matrix(covariance: np.ndarray, count: int) -> Float[np.ndarray, "rows rows"]:
    """The covariance as a full matrix."""
    if covariance.ndim == 1:
        return np.diag(covariance)
    if covariance.ndim == 3:
        full = np.zeros((len(covariance), 3, len(covariance), 3))
        full[np.arange(len(covariance)), :, np.arange(len(covariance)), :] = covariance
        return full.reshape(count, count)
    return np.kron(covariance, np.eye(3)) if len(covariance) < count else covariance
