"""Products of residual-space vectors under several covariances at once, without making any row white.

With the precisions P of the white rows and the orthonormal basis Q of the nominal model's column space, the products of
vectors X of the residual space under a covariance are `X'PX - C'C`, where `L L' = Q'PQ` and `C = L^-1 Q'PX`; half the
logarithm of its determinant there is that of the whole covariance plus the sum of `log diag L` (Harville 1974).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.noise.repeats import Repeats
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.showing import brief
from tumblecal.noise.covariance import Covariance


class _Form(NamedTuple):
    """Precisions of the covariances `numbers`, all of one form, and half the logarithms of their determinants; `of_means`:
    whether of means and differences of repeats."""

    form: str
    of_means: bool
    numbers: list[int]
    precision: np.ndarray
    half_log_dets: Float[np.ndarray, " own"]

    @classmethod
    def of(cls, form: str, of_means: bool, numbers: list[int], values: np.ndarray) -> "_Form":
        """From the stacked values of the covariances."""
        if form == "rows":
            return cls(form, of_means, numbers, 1.0 / values, 0.5 * np.log(values).sum(axis=1))
        diagonals = np.linalg.cholesky(values).diagonal(axis1=-2, axis2=-1)
        repeated = 3.0 if form == "between" else 1.0
        half_log_dets = repeated * np.log(diagonals).reshape(len(numbers), -1).sum(axis=1)
        return cls(form, of_means, numbers, np.linalg.inv(values), half_log_dets)

    def times(self, rows: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "own rows columns"]:
        """The precisions times the readings' rows."""
        size, columns, made = len(rows), rows.shape[1], len(self.numbers)
        if self.form == "rows":
            return self.precision[:, :, None] * rows
        if self.form == "by_axis":
            by_axis = rows.reshape(-1, 3, columns).swapaxes(0, 1)
            return (self.precision @ by_axis).swapaxes(1, 2).reshape(made, size, columns)
        shape = {"between": (size // 3, 3 * columns), "blocks": (size // 3, 3, columns), "full": (size, columns)}
        return (self.precision @ rows.reshape(shape[self.form])).reshape(made, size, columns)

    def squares(self, rows: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "own columns"]:
        """Sums of squares of the readings' rows under each covariance."""
        if self.form == "rows":
            return self.precision @ rows**2
        return np.einsum("rc,krc->kc", rows, self.times(rows))


@dataclass(frozen=True)
class Whitening:
    """Covariances of the readings' white rows on the residual space of a problem.

    If the column space of the nominal model is larger than its residual space (free tilts), the covariances are computed on
    the residual space. `of_means`: which covariances are of means over `repeats`, and differences.
    """

    __repr__ = brief

    at: Tangent
    covariances: Sequence[Covariance]
    repeats: Repeats | None = None
    of_means: Sequence[bool] = ()

    @cached_property
    def half_log_dets(self) -> Float[np.ndarray, " covariances"]:
        """Half the logarithms of the determinants on the residual space."""
        if not self._on_rows:
            return -_log_diagonals(self._roots)
        whole = np.concatenate([form.half_log_dets for form in self._forms])[self._order]
        return whole + _log_diagonals(self._triangles)

    def products(self, x: Float[np.ndarray, "nu columns"]) -> Float[np.ndarray, "covariances columns columns"]:
        """Products of vectors of the residual space with each other under each covariance."""
        if not self.covariances:
            return np.zeros((0, x.shape[1], x.shape[1]))
        if not self._on_rows:
            white = self._roots @ x
            return white.mT @ white
        rows, rank = self.at.basis @ x, self.at.reached.shape[1]
        weighted = self._weighted(rows, np.hstack([self.at.reached, rows]))
        along = np.linalg.solve(self._triangles, weighted[:, :, :rank].mT)
        return weighted[:, :, rank:] - along.mT @ along

    def squares(self, x: Float[np.ndarray, "nu columns"]) -> Float[np.ndarray, "covariances columns"]:
        """Sums of squares of vectors of the residual space under each covariance; of many in less memory."""
        if x.shape[1] == 1:
            return self.products(x)[:, 0]
        if not self._on_rows:
            return np.sum((self._roots @ x) ** 2, axis=1)
        rows, count = self.at.basis @ x, self._count
        own = np.concatenate([form.squares(self._turned(rows, form)) for form in self._forms])[self._order]
        along = (self._coordinates.reshape(-1, len(rows)) @ rows).reshape(len(own), -1, x.shape[1])
        return own + np.sum(rows[count:] ** 2, axis=0) - np.sum(along**2, axis=1)

    @property
    def _on_rows(self) -> bool:
        return self.at.reached.shape[1] <= self.at.dof

    @property
    def _count(self) -> int:
        return self.at.problem.readings.size

    @cached_property
    def _forms(self) -> list[_Form]:
        of_means = self.of_means or [False] * len(self.covariances)
        forms = [(covariance.form, own) for covariance, own in zip(self.covariances, of_means, strict=True)]
        numbers = {own: [k for k, other in enumerate(forms) if other == own] for own in dict.fromkeys(forms)}
        return [
            _Form.of(*own, listed, np.stack([self.covariances[k].values for k in listed]))
            for own, listed in numbers.items()
        ]

    @cached_property
    def _order(self) -> Int[np.ndarray, " covariances"]:
        """Where each covariance is in the forms' arrays, one after the other."""
        return np.argsort([number for form in self._forms for number in form.numbers])

    def _turned(self, rows: Float[np.ndarray, "rows columns"], form: _Form) -> Float[np.ndarray, "readings columns"]:
        """The readings' rows as a form has them."""
        turned = self.repeats.turned(rows) if form.of_means and self.repeats is not None else rows
        return turned[: self._count]

    def _weighted(
        self, one: Float[np.ndarray, "rows columns"], other: Float[np.ndarray, "rows others"]
    ) -> Float[np.ndarray, "covariances columns others"]:
        """Products of rows under the whole covariances; those of priors have variance one."""
        priors = one[self._count :].T @ other[self._count :]
        own = [self._turned(one, form).T @ form.times(self._turned(other, form)) for form in self._forms]
        return np.concatenate(own)[self._order] + priors

    @cached_property
    def _triangles(self) -> Float[np.ndarray, "covariances reached reached"]:
        """Lower triangles of the products of the column space's basis."""
        return np.linalg.cholesky(self._weighted(self.at.reached, self.at.reached))

    @cached_property
    def _coordinates(self) -> Float[np.ndarray, "covariances reached rows"]:
        """The coordinates of rows along the column space, normalised under each covariance, by rows."""
        return np.linalg.solve(self._triangles, self._weighted(np.eye(len(self.at.basis)), self.at.reached).mT)

    @cached_property
    def _roots(self) -> Float[np.ndarray, "covariances nu nu"]:
        """Roots of the precisions on the residual space."""
        readings, priors = np.split(self.at.basis, [self._count])
        of_means = self.of_means or [False] * len(self.covariances)
        turned = readings if self.repeats is None else self.repeats.turned(readings)
        rows = [turned if own else readings for own in of_means]
        own = np.stack([x.T @ covariance.times(x) for covariance, x in zip(self.covariances, rows, strict=True)])
        return np.linalg.inv(np.linalg.cholesky(own + priors.T @ priors))


def _log_diagonals(triangles: Float[np.ndarray, "covariances size size"]) -> Float[np.ndarray, " covariances"]:
    """Logarithms of the determinants of triangles."""
    return np.log(triangles.diagonal(axis1=-2, axis2=-1)).sum(axis=-1)
