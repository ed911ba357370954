"""A covariance in the form that suits it, and rows made white by it.

Rows are positions times axes, the axis running fastest. Rows behind them (those of priors) have variance one and are left
alone. White rows, determinant and draws come from the lower Cholesky factor (Golub and Van Loan 2013, section 4.2.5).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Covariance:
    """A covariance of `count` rows.

    `values` has one of five forms, told apart by `form`: `"rows"` (rows): a diagonal; `"between"` (positions,
    positions): the same for the three axes; `"by_axis"` (3, positions, positions): the axes independent; `"blocks"`
    (positions, 3, 3): the positions independent; `"full"` (rows, rows).
    """

    values: np.ndarray
    form: str

    @classmethod
    def by_axis(cls, values: Float[np.ndarray, "3 positions positions"]) -> "Covariance":
        """Independent axes."""
        return cls(values, "by_axis")

    @property
    def count(self) -> int:
        """Number of rows."""
        return len(self.values) if self.form in ("rows", "full") else 3 * self.values.shape[1 if self._axes else 0]

    @property
    def _axes(self) -> bool:
        return self.form == "by_axis"

    @cached_property
    def root(self) -> np.ndarray:
        """Standard deviations, or lower triangles, in the form of `values`.

        **Raises:** `numpy.linalg.LinAlgError` when a matrix is not positive definite.
        """
        return np.sqrt(self.values) if self.form == "rows" else np.linalg.cholesky(self.values)

    def whiten(self, rows: Float[np.ndarray, " rows *columns"]) -> Float[np.ndarray, " rows *columns"]:
        """Rows of variance one without correlation, from rows with this covariance."""
        readings = rows[: self.count].reshape(self.count, -1)
        if self.form == "rows":
            white = readings / self.root[:, None]
        elif self.form == "by_axis":
            by_axis = readings.reshape(-1, 3, readings.shape[1]).swapaxes(0, 1)
            white = np.linalg.solve(self.root, by_axis).swapaxes(0, 1)
        elif self.form == "blocks":
            white = np.linalg.solve(self.root, readings.reshape(-1, 3, readings.shape[1]))
        else:
            white = np.linalg.solve(self.root, readings.reshape(len(self.root), -1))
        return np.concatenate([white.reshape(self.count, *rows.shape[1:]), rows[self.count :]])

    @cached_property
    def half_log_det(self) -> float:
        """Half the logarithm of the determinant."""
        if self.form == "rows":
            return float(np.sum(np.log(self.root)))
        total = float(np.sum(np.log(np.diagonal(self.root, axis1=-2, axis2=-1))))
        return 3 * total if self.form == "between" else total

    def sample(self, generator: np.random.Generator, draws: int) -> Float[np.ndarray, "rows draws"]:
        """Normal rows of mean zero with this covariance."""
        white = generator.standard_normal((self.count, draws))
        if self.form == "rows":
            return self.root[:, None] * white
        if self.form == "by_axis":
            return (self.root @ white.reshape(-1, 3, draws).swapaxes(0, 1)).swapaxes(0, 1).reshape(self.count, draws)
        if self.form == "blocks":
            return (self.root @ white.reshape(-1, 3, draws)).reshape(self.count, draws)
        return (self.root @ white.reshape(len(self.root), -1)).reshape(self.count, draws)

    @cached_property
    def matrix(self) -> Float[np.ndarray, "rows rows"]:
        """The covariance as a full matrix."""
        if self.form == "rows":
            return np.diag(self.values)
        if self.form == "full":
            return self.values
        if self.form == "between":
            return np.kron(self.values, np.eye(3))
        size = self.count // 3
        full = np.zeros((size, 3, size, 3))
        if self._axes:
            full[:, np.arange(3), :, np.arange(3)] = self.values
        else:
            full[np.arange(size), :, np.arange(size), :] = self.values
        return full.reshape(self.count, self.count)
