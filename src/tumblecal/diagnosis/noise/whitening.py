"""Vectors of the residual space under several covariances: what the nominal model leaves of them when they are white.

The rows and the nominal model's column space are made white by a covariance; the rest of the rows beyond the column space has
the products of generalised least squares, and half the logarithm of the covariance's determinant on the residual space is that
of the whole covariance plus the logarithms of the triangle of the white column space (Harville 1974). If the column space is
larger than the residual space (free tilts), the covariance is computed on the residual space instead.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.noise.repeats import Repeats
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.showing import brief
from tumblecal.noise.covariance import Covariance


# So many numbers of vectors are made white at once.
_NUMBERS_AT_ONCE = 100_000


@dataclass(frozen=True)
class Whitening:
    """Covariances of the readings' white rows on the residual space of a problem; `of_means`: which of them are of means over
    `repeats`, and differences."""

    __repr__ = brief

    at: Tangent
    covariances: Sequence[Covariance]
    repeats: Repeats
    of_means: Sequence[bool]

    @property
    def half_log_dets(self) -> Float[np.ndarray, " covariances"]:
        """Half the logarithms of the determinants on the residual space."""
        if not self._on_rows:
            return -_log_diagonals(self._roots)
        whole = np.array([covariance.half_log_det for covariance in self.covariances])
        return whole + _log_diagonals(self._fitted[1])

    def products(self, x: Float[np.ndarray, "nu columns"]) -> Float[np.ndarray, "covariances columns columns"]:
        """Products of vectors of the residual space with each other under each covariance."""
        white, along = self._white_and_along(x)
        return white.mT @ white - along.mT @ along

    def squares(self, x: Float[np.ndarray, "nu columns"]) -> Float[np.ndarray, "covariances columns"]:
        """Sums of squares of vectors of the residual space under each covariance; some at once, to need less memory."""
        parts = (self._white_and_along(part) for part in np.array_split(x, 1 + x.size // _NUMBERS_AT_ONCE, axis=1))
        return np.hstack([np.sum(white**2, axis=1) - np.sum(along**2, axis=1) for white, along in parts])

    @property
    def _on_rows(self) -> bool:
        return self.at.reached.shape[1] <= self.at.dof

    def _white_and_along(
        self, x: Float[np.ndarray, "nu columns"]
    ) -> tuple[Float[np.ndarray, "covariances rows columns"], Float[np.ndarray, "covariances rank columns"]]:
        """Vectors made white by each covariance, and their coordinates along the white column space, if it is not left out."""
        if not self._on_rows:
            white = self._roots @ x
            return white, white[:, :0]
        (reached, triangles), white = self._fitted, self._white(self.at.basis @ x)
        return white, np.linalg.solve(triangles, reached.mT @ white)

    @cached_property
    def _fitted(self) -> tuple[Float[np.ndarray, "covariances rows rank"], Float[np.ndarray, "covariances rank rank"]]:
        """The white column space under each covariance, and the lower triangles of its products."""
        white = self._white(self.at.reached)
        return white, np.linalg.cholesky(white.mT @ white)

    @cached_property
    def _roots(self) -> Float[np.ndarray, "covariances nu nu"]:
        """Roots of the precisions on the residual space."""
        products = np.zeros((len(self.covariances), self.at.dof, self.at.dof))
        for own, covariance, of_means in zip(products, self.covariances, self.of_means, strict=True):
            rows = self.repeats.turned(self.at.basis) if of_means else self.at.basis
            readings, priors = np.split(rows, [covariance.count])
            own += readings.T @ covariance.times(readings) + priors.T @ priors
        return np.linalg.inv(np.linalg.cholesky(products))

    def _white(self, rows: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "covariances rows columns"]:
        """Rows made white by each covariance."""
        white = rows * self._weights[:, :, None]
        for number, (covariance, of_means) in enumerate(zip(self.covariances, self.of_means, strict=True)):
            if of_means or covariance.form != "rows":
                white[number] = covariance.whiten(self.repeats.turned(rows) if of_means else rows)
        return white

    @cached_property
    def _weights(self) -> Float[np.ndarray, "covariances rows"]:
        """Weights of the rows under each diagonal covariance."""
        weights = np.ones((len(self.covariances), len(self.at.basis)))
        for own, covariance in zip(weights, self.covariances, strict=True):
            if covariance.form == "rows":
                own[: covariance.count] /= covariance.root
        return weights


def _log_diagonals(triangles: Float[np.ndarray, "covariances size size"]) -> Float[np.ndarray, " covariances"]:
    """Logarithms of the determinants of triangles."""
    return np.log(triangles.diagonal(axis1=-2, axis2=-1)).sum(axis=-1)
