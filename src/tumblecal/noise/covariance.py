"""A covariance in a compact form, and white rows by it.

Rows are positions times axes; the axis varies fastest. Further rows (those of priors) have variance one and are
unchanged. White rows, determinant and draws use the lower Cholesky factor (Golub and Van Loan 2013, section 4.2.5).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Covariance:
    """A covariance of `count` rows.

    `values` has one of five forms, stated by `form`: `"rows"` (rows): a diagonal; `"between"` (positions,
    positions): the same for the three axes; `"by_axis"` (3, positions, positions): the axes independent; `"blocks"`
    (positions, 3, 3): the positions independent; `"full"` (rows, rows).

    Examples:
        >>> import numpy as np
        >>> from tumblecal.noise import Covariance
        >>> noise = Covariance.of_sd(np.full((24, 3), 1e-4))  # g
        >>> noise.count, noise.whiten(np.full(72, 2e-4))[0].round(6).item()
        (72, 2.0)
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
        return len(self.values) if self.form in ("rows", "full") else 3 * self.values.shape[self.form == "by_axis"]

    @cached_property
    def root(self) -> np.ndarray:
        """Standard deviations, or lower triangles, in the form of `values`.

        **Raises:** `numpy.linalg.LinAlgError` when a matrix is not positive definite.
        """
        return np.sqrt(self.values) if self.form == "rows" else np.linalg.cholesky(self.values)

    def _by_form(
        self, operate: Callable[[np.ndarray], np.ndarray], rows: Float[np.ndarray, "rows columns"]
    ) -> Float[np.ndarray, "rows columns"]:
        """The result of an operation on rows in the layout of the form's matrices."""
        if self.form == "by_axis":
            by_axis = rows.reshape(self.count // 3, 3, -1).swapaxes(0, 1)
            return operate(by_axis).swapaxes(0, 1).reshape(rows.shape)
        size = (self.count // 3, 3) if self.form == "blocks" else (len(self.values),)
        return operate(rows.reshape(*size, -1)).reshape(rows.shape)

    def whiten(self, rows: Float[np.ndarray, " *shape"]) -> Float[np.ndarray, " *shape"]:
        """Rows of variance one without correlation, from rows with this covariance."""
        readings = rows[: self.count].reshape(self.count, int(np.prod(rows.shape[1:])))
        if self.form == "rows":
            white = readings / self.root[:, None]
        else:
            white = self._by_form(lambda parts: np.linalg.solve(self.root, parts), readings)
        return np.concatenate([white.reshape(self.count, *rows.shape[1:]), rows[self.count :]])

    def times(self, rows: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "rows columns"]:
        """The covariance times the rows, without its full matrix."""
        if self.form == "rows":
            return self.values[:, None] * rows
        return self._by_form(lambda parts: self.values @ parts, rows)

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
        """The factor that makes rows white by multiplication: 1/sd (rows,), or lower triangles, (3, positions, positions) for
        independent axes, otherwise (rows, rows)."""
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
        return self._by_form(lambda parts: self.root @ parts, white)

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
        if self.form == "by_axis":
            full[:, np.arange(3), :, np.arange(3)] = self.values
        else:
            full[np.arange(size), :, np.arange(size), :] = self.values
        return full.reshape(self.count, self.count)
