"""Errors of readings as white rows, by any form of a problem's whitening, in numpy or JAX.

A whitening is 1/sd of each reading (rows,), a matrix for each axis (3, positions, positions), or one for all (rows, rows).
Rows are positions times axes; the axis varies fastest.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from tumblecal.noise.covariance import Covariance


def white(whitening: Any, values: Any) -> Any:
    """White rows (rows, ...) of values given for every reading (positions, 3, ...)."""
    stacked = values.reshape(values.shape[0] * values.shape[1], *values.shape[2:])
    if whitening.ndim == 2:
        return whitening @ stacked
    if whitening.ndim == 3:
        by_axis = jnp.einsum if isinstance(values, jax.Array) else np.einsum
        return by_axis("apq,qa...->pa...", whitening, values).reshape(stacked.shape)
    return stacked * whitening.reshape(-1, *([1] * (stacked.ndim - 1)))


def unwhitened(whitening: np.ndarray, rows: Float[np.ndarray, " rows"]) -> Float[np.ndarray, "positions 3"]:
    """The values of white rows; the inverse of `white`."""
    if whitening.ndim == 3:
        return np.linalg.solve(whitening, rows.reshape(-1, 3).T[:, :, None])[:, :, 0].T
    values = rows / whitening if whitening.ndim == 1 else np.linalg.solve(whitening, rows)
    return values.reshape(-1, 3)


def whitening_matrix(whitening: np.ndarray) -> Float[np.ndarray, "rows rows"]:
    """The matrix that makes rows white by multiplication from the left."""
    if whitening.ndim == 3:
        return Covariance(whitening, "by_axis").matrix
    return np.diag(whitening) if whitening.ndim == 1 else whitening


def log_determinant(
    whitening: Float[Array, " *shape"], used: Bool[np.ndarray, " positions"]
) -> tuple[Float[Array, ""] | float, Float[Array, ""]]:
    """Number of the rows of the positions used, and the logarithm of their whitening's determinant; positions under correlated
    noise are all used."""
    if whitening.ndim > 1:
        return 3.0 * len(used), jnp.sum(jnp.linalg.slogdet(whitening)[1])
    rows = jnp.repeat(jnp.asarray(used), 3)
    return jnp.sum(rows.astype(float)), jnp.sum(jnp.where(rows, jnp.log(whitening), 0.0))
