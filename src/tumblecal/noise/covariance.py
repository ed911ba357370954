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
    def of_sd(cls, sd: np.ndarray) -> "Covariance":
        """Independent rows with these standard deviations (positions, 3)."""
        return cls(np.square(sd, dtype=float).ravel(), "rows")

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

    def whiten(self, rows: Float[np.ndarray, " *shape"]) -> Float[np.ndarray, " *shape"]:
        """Rows of variance one without correlation, from rows with this covariance."""
        columns = int(np.prod(rows.shape[1:]))
        readings = rows[: self.count].reshape(self.count, columns)
        if self.form == "rows":
            white = readings / self.root[:, None]
        elif self.form == "by_axis":
            by_axis = readings.reshape(self.count // 3, 3, columns).swapaxes(0, 1)
            white = np.linalg.solve(self.root, by_axis).swapaxes(0, 1)
        elif self.form == "blocks":
            white = np.linalg.solve(self.root, readings.reshape(self.count // 3, 3, columns))
        else:
            size = len(self.root)
            white = np.linalg.solve(self.root, readings.reshape(size, self.count // size * columns))
        return np.concatenate([white.reshape(self.count, *rows.shape[1:]), rows[self.count :]])

    def times(self, rows: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "rows columns"]:
        """The covariance times the rows, its whole matrix never made."""
        if self.form == "rows":
            return self.values[:, None] * rows
        if self.form in ("full", "between"):
            return (self.values @ rows.reshape(len(self.values), -1)).reshape(rows.shape)
        readings = rows.reshape(self.count // 3, 3, -1)
        product = (self.values @ readings.swapaxes(0, 1)).swapaxes(0, 1) if self._axes else self.values @ readings
        return product.reshape(rows.shape)

    @cached_property
    def half_log_det(self) -> float:
        """Half the logarithm of the determinant."""
        if self.form == "rows":
            return float(np.sum(np.log(self.root)))
        total = float(np.sum(np.log(np.diagonal(self.root, axis1=-2, axis2=-1))))
        return 3 * total if self.form == "between" else total

    @cached_property
    def sd(self) -> Float[np.ndarray, " rows"]:
        """Standard deviation of every row by itself."""
        return np.sqrt(self.values if self.form == "rows" else np.diag(self.matrix))

    @cached_property
    def inverse_root(self) -> np.ndarray:
        """What makes rows white by multiplication: 1/sd (rows,), or lower triangles, (3, positions, positions) for
        independent axes, else (rows, rows)."""
        if self.form == "rows":
            return 1.0 / self.root
        if self.form == "by_axis":
            return np.linalg.inv(self.root)
        return np.linalg.solve(np.linalg.cholesky(self.matrix), np.eye(self.count))

    def compounded(self, relative: "Covariance") -> "Covariance":
        """The covariance of rows which, made white by this one, have the covariance `relative`."""
        if self.form == relative.form == "rows":
            return Covariance(self.values * relative.values, "rows")
        if self.form == "rows":
            sd = np.sqrt(self.values)
            return Covariance(relative.matrix * np.outer(sd, sd), "full")
        root = np.linalg.cholesky(self.matrix)
        return Covariance(root @ relative.matrix @ root.T, "full")

    def sample(self, generator: np.random.Generator, draws: int) -> Float[np.ndarray, "rows draws"]:
        """Normal rows of mean zero with this covariance."""
        white = generator.standard_normal((self.count, draws))
        if self.form == "rows":
            return self.root[:, None] * white
        if self.form == "by_axis":
            return (
                (self.root @ white.reshape(self.count // 3, 3, draws).swapaxes(0, 1))
                .swapaxes(0, 1)
                .reshape(white.shape)
            )
        if self.form == "blocks":
            return (self.root @ white.reshape(self.count // 3, 3, draws)).reshape(white.shape)
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
