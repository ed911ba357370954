"""Vectors of the residual space made white by several covariances at once."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.model.tangent import Tangent
from tumblecal.diagnosis.noise.repeats import Repeats
from tumblecal.ground.showing import brief
from tumblecal.noise.covariance import Covariance


class _Form(NamedTuple):
    """Covariances of one form by their numbers, whether they are `of_means` and differences of repeats, and what makes rows
    white: inverse roots in that form, where it has such."""

    form: str
    of_means: bool
    numbers: list[int]
    inverse: np.ndarray


@dataclass(frozen=True)
class Whitening:
    """Covariances of the readings' white rows on the residual space of a problem.

    If the column space of the nominal model is smaller than its residual space, rows are whitened and their part in the column
    space is removed. Otherwise (free tilts) the covariances are computed on the residual space. `of_means`: which covariances
    are of means over `repeats`, and differences.
    """

    __repr__ = brief

    at: Tangent
    covariances: Sequence[Covariance]
    repeats: Repeats | None = None
    of_means: Sequence[bool] = ()

    @property
    def _of_means(self) -> Sequence[bool]:
        return self.of_means or [False] * len(self.covariances)

    @property
    def on_rows(self) -> bool:
        """Whether whole rows are made white."""
        return self.at.reached.shape[1] <= self.at.dof

    @cached_property
    def half_log_dets(self) -> Float[np.ndarray, " covariances"]:
        """Half the logarithms of the determinants on the residual space."""
        if not self.on_rows:
            return -_log_diagonals(self._roots)
        # The whole, times that of the precision on what the nominal model reaches.
        return self._whole_half_log_dets + _log_diagonals(self._reached[1])

    def whitened(self, x: Float[np.ndarray, "nu columns"]) -> Float[np.ndarray, "covariances white columns"]:
        """Vectors whitened by each covariance, without their part in the column space of the nominal model."""
        if not self.on_rows:
            return self._roots @ x
        (nominal, triangles), white = self._reached, self._white(self.at.basis @ x)
        along = np.linalg.solve(triangles, nominal.mT @ white)
        return white - nominal @ np.linalg.solve(triangles.mT, along)

    def squares(self, x: Float[np.ndarray, "nu columns"]) -> Float[np.ndarray, "covariances columns"]:
        """Sums of squares of these."""
        if not self.on_rows:
            return _summed(self._roots @ x)
        (nominal, triangles), white = self._reached, self._white(self.at.basis @ x)
        return _summed(white) - _summed(np.linalg.solve(triangles, nominal.mT @ white))

    @cached_property
    def _roots(self) -> Float[np.ndarray, "covariances nu nu"]:
        """What makes vectors of the residual space white."""
        readings, priors = np.split(self.at.basis, [self.at.problem.readings.size])
        turned = readings if self.repeats is None else self.repeats.turned(readings)
        rows = [turned if own else readings for own in self._of_means]
        own = np.stack([x.T @ covariance.times(x) for covariance, x in zip(self.covariances, rows, strict=True)])
        return np.linalg.inv(np.linalg.cholesky(own + priors.T @ priors))

    @cached_property
    def _reached(
        self,
    ) -> tuple[Float[np.ndarray, "covariances rows reached"], Float[np.ndarray, "covariances reached reached"]]:
        """What the nominal model reaches made white, and the lower triangles of the products of its columns."""
        white = self._white(self.at.reached)
        return white, np.linalg.cholesky(white.mT @ white)

    @cached_property
    def _whole_half_log_dets(self) -> Float[np.ndarray, " covariances"]:
        """Half the logarithms of the determinants of the whole covariances."""
        half_log_dets = np.zeros(len(self.covariances))
        for form, _, numbers, inverse in self._forms:
            if form == "rows":
                half_log_dets[numbers] = -np.log(inverse).sum(axis=1)
            elif form in ("between", "blocks"):
                repeated = 3 if form == "between" else 1
                half_log_dets[numbers] = -repeated * _log_diagonals(inverse).reshape(len(numbers), -1).sum(axis=1)
            else:
                half_log_dets[numbers] = [self.covariances[k].half_log_det for k in numbers]
        return half_log_dets

    @cached_property
    def _forms(self) -> list[_Form]:
        forms = [(covariance.form, own) for covariance, own in zip(self.covariances, self._of_means, strict=True)]
        made = []
        for form, own in dict.fromkeys(forms):
            numbers = [k for k, other in enumerate(forms) if other == (form, own)]
            inverse = np.zeros(0)
            if form in ("rows", "between", "blocks"):
                values = np.stack([self.covariances[k].values for k in numbers])
                inverse = 1.0 / np.sqrt(values) if form == "rows" else np.linalg.inv(np.linalg.cholesky(values))
            made.append(_Form(form, own, numbers, inverse))
        return made

    def _white(self, rows: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "covariances rows columns"]:
        """Rows made white by each covariance, those of one form at once."""
        white, count = np.empty((len(self.covariances), *rows.shape)), self.at.problem.readings.size
        white[:, count:] = rows[count:]
        whole = {False: rows} | ({} if self.repeats is None else {True: self.repeats.turned(rows)})
        for form, of_means, numbers, inverse in self._forms:
            own = whole[of_means]
            readings = own[:count].reshape(count // 3, 3, -1)
            if form == "rows":
                white[numbers, :count] = inverse[:, :, None] * own[:count]
            elif form == "between":
                white[numbers, :count] = (inverse @ readings.reshape(count // 3, -1)).reshape(len(numbers), count, -1)
            elif form == "blocks":
                white[numbers, :count] = (inverse @ readings).reshape(len(numbers), count, -1)
            else:
                white[numbers] = [self.covariances[k].whiten(own) for k in numbers]
        return white


def _log_diagonals(triangles: Float[np.ndarray, "*covariances size size"]) -> Float[np.ndarray, "*covariances"]:
    """Logarithms of the determinants of triangles."""
    return np.log(triangles.diagonal(axis1=-2, axis2=-1)).sum(axis=-1)


def _summed(white: Float[np.ndarray, "covariances white columns"]) -> Float[np.ndarray, "covariances columns"]:
    """Sums of squares."""
    return np.einsum("cwx,cwx->cx", white, white)
