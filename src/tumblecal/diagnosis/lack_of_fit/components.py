"""Processes in the residual space by their size: explained sum of squares, determinant, principal components.

Signals P of a process of size one with products G = P'P make the covariance `I + s^2 P P'`. For one residual vector z no
eigenvalues are needed: turned to a tridiagonal form with P'z along its last direction (Golub and Van Loan 2013, section
8.3.1), one factorisation serves all sizes. For many vectors the principal components are faster.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg.lapack import dpttrf, dsytrd  # type: ignore[attr-defined]

from tumblecal.full_model.evidence import LARGEST, SMALLEST, log_evidence_of_noise
from tumblecal.ground.showing import brief


# Components of less than this share of the largest one's variance are no more than rounding.
_ROUNDING = 1e-12
# The sizes tried.
SIZES = np.exp(np.linspace(np.log(SMALLEST), np.log(LARGEST), 16))


class BySize(NamedTuple):
    """Sums of squares that processes of every size explain of residual vectors, and half the logarithms of the determinants; a
    process of size s has the norm s over all readings."""

    explained: Float[np.ndarray, "processes sizes draws"]
    half_log_dets: Float[np.ndarray, "processes sizes"]

    def log_evidence(self, z: Float[np.ndarray, "draws nu"], known: bool) -> Float[np.ndarray, "processes sizes draws"]:
        """Log evidence of each process and size, on the scale of `evidence.log_evidence`."""
        total = np.vecdot(z, z)
        residual_ss = total - self.explained
        scores = log_evidence_of_noise(np.maximum(residual_ss, 1e-12 * total, out=residual_ss), z.shape[1], known)
        return np.subtract(scores, self.half_log_dets[:, :, None], out=scores)


def mean_over_sizes(scores: Float[np.ndarray, "processes sizes draws"]) -> Float[np.ndarray, "processes draws"]:
    """Log evidence averaged over the sizes."""
    highest = scores.max(axis=1)
    above = scores - highest[:, None]
    return highest + np.log(np.exp(above, out=above).sum(axis=1) / len(SIZES))


def of_one_vector(
    products: Sequence[Float[np.ndarray, "processes signals signals"]],
    inner: Sequence[Float[np.ndarray, "processes signals"]],
) -> BySize:
    """Of one residual vector, by the signals' products with each other and with it; a list for each number of signals."""
    parts = [_tridiagonal(*own) for own in zip(products, inner, strict=True)]
    diagonal, off_diagonal, squares = (np.concatenate(part) for part in zip(*parts, strict=True))
    counts = np.concatenate([np.full(len(own), own.shape[1]) for own in inner])
    last = np.cumsum(counts) - 1
    first = last + 1 - counts
    scales = SIZES**2 / np.maximum(np.add.reduceat(diagonal, first), 1e-300)[:, None]
    of_columns = np.repeat(scales.T, counts, axis=1)
    # The rest of a process of one size without its last direction, and all of the next process, are separate: no element
    # couples them.
    off_diagonal = of_columns * off_diagonal
    of_columns *= diagonal
    of_columns += 1.0
    pivots = dpttrf(of_columns.ravel(), off_diagonal.ravel()[:-1], overwrite_d=1, overwrite_e=1)[0]
    pivots = pivots.reshape(of_columns.shape)
    explained = scales * squares[:, None] / pivots[:, last].T
    return BySize(explained[:, :, None], 0.5 * np.add.reduceat(np.log(pivots, out=pivots), first, axis=1).T)


def _tridiagonal(
    products: Float[np.ndarray, "processes signals signals"], inner: Float[np.ndarray, "processes signals"]
) -> tuple[Float[np.ndarray, " columns"], Float[np.ndarray, " columns"], Float[np.ndarray, " processes"]]:
    """Products, rotated process by process: their diagonals, their off-diagonals (0 last), and the square of the last
    coordinate of the products with the residual vector, which has no other."""
    count, signals = inner.shape
    bordered = np.zeros((count, signals + 1, signals + 1))
    bordered[:, :-1, :-1], bordered[:, -1, :-1] = products, inner
    diagonal, off_diagonal = np.empty((count, signals + 1)), np.empty((count, signals))
    for row, matrix in enumerate(bordered.swapaxes(1, 2)):
        _, diagonal[row], off_diagonal[row], _, _ = dsytrd(matrix, lower=0, overwrite_a=1)
    squares = off_diagonal[:, -1] ** 2
    off_diagonal[:, -1] = 0.0
    return diagonal[:, :-1].ravel(), off_diagonal.ravel(), squares


@dataclass(frozen=True)
class Components:
    """Principal components of processes that are sums of signals with independent coefficients of variance one.

    `variances` of the components of a process of size one, increasing, 0 for omitted ones; `mixed`: the signals' shares in
    each.
    """

    __repr__ = brief

    variances: Float[np.ndarray, "processes components"]
    mixed: Float[np.ndarray, "processes signals components"]

    @classmethod
    def of(cls, products: Float[np.ndarray, "processes signals signals"]) -> "Components":
        """The components of signals, from their products with each other."""
        variances, mixed = np.linalg.eigh(products)
        return cls(np.where(variances > _ROUNDING * variances[:, -1:], variances, 0.0), mixed)

    @cached_property
    def scaled(self) -> Float[np.ndarray, "processes sizes components"]:
        """Variances of the components of processes of every size."""
        total = np.maximum(np.sum(self.variances, axis=1, keepdims=True), 1e-300)
        return (SIZES**2 / total)[:, :, None] * self.variances[:, None]

    @cached_property
    def explained(self) -> Float[np.ndarray, "processes sizes components"]:
        """The shares of the squares along the components that processes of every size explain."""
        return self.scaled / (1.0 + self.scaled)

    @cached_property
    def normalised(self) -> Float[np.ndarray, "processes signals components"]:
        """The signals' shares in orthonormal directions of the components, 0 for omitted ones."""
        kept = self.variances > 0
        return self.mixed * np.where(kept, 1.0 / np.sqrt(np.where(kept, self.variances, 1.0)), 0.0)[:, None]

    @cached_property
    def _half_log_dets(self) -> Float[np.ndarray, "processes sizes"]:
        return 0.5 * np.sum(np.log1p(self.scaled), axis=2)

    def of_vectors(self, along: Float[np.ndarray, "processes components draws"]) -> BySize:
        """Of many residual vectors, by their coordinates along the orthonormal directions."""
        return BySize(self.explained @ along**2, self._half_log_dets)
