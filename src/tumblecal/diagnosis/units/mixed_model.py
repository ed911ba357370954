"""Normal equations of units, and the linear mixed model in closed form (equations: `units`)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import gammaincc


# Directions of information below this share of the largest contain only rounding errors.
ROUNDING = 1e-9

Columns = Sequence[int] | Int[np.ndarray, " columns"]


class NormalEquations(NamedTuple):
    """Of linear coefficients, for one unit or, with leading axes, for many; the last of those axes is that of the units.

    - `gram` = X' M X; `towards` = X' M z. `log_evidence`: without these coefficients.
    """

    gram: Float[np.ndarray, "*units columns columns"]
    towards: Float[np.ndarray, "*units columns"]
    log_evidence: Float[np.ndarray, " *units"] | float = 0.0

    @classmethod
    def stacked(cls, units: "Sequence[NormalEquations]") -> "NormalEquations":
        """Of many units."""
        return cls(*(np.stack(part) for part in zip(*units, strict=True)))

    def only(self, units: Bool[np.ndarray, " units"] | Int[np.ndarray, " kept"]) -> "NormalEquations":
        """Of some of the units."""
        return NormalEquations(*(np.asarray(part)[units] for part in self))

    @property
    def total(self) -> "NormalEquations":
        """Of coefficients common to the units."""
        return NormalEquations(self.gram.sum(axis=-3), self.towards.sum(axis=-2), np.sum(self.log_evidence, axis=-1))

    def of(self, columns: Columns) -> "NormalEquations":
        """Of some coefficients, the others being zero."""
        columns = list(columns)
        return self._replace(gram=self.gram[..., columns, :][..., columns], towards=self.towards[..., columns])

    def along(self, axes: Float[np.ndarray, "columns k"]) -> "NormalEquations":
        """Of combinations of the coefficients."""
        return self._replace(gram=axes.T @ self.gram @ axes, towards=self.towards @ axes)

    def given(self, coefficients: Float[np.ndarray, "*units columns"]) -> "NormalEquations":
        """Of the differences from these coefficients."""
        return self._replace(towards=self.towards - np.matvec(self.gram, coefficients))

    def solved(self) -> Float[np.ndarray, "*units columns"]:
        """Least-squares estimates; 0 for combinations that the data do not show."""
        return np.matvec(pseudo_inverse(self.gram), self.towards)

    def eliminated(self, columns: Columns, inverse: Float[np.ndarray, "*units k k"] | None = None) -> "NormalEquations":
        """With some coefficients estimated in every unit, of which nothing is left then, or with this inverse of the
        information on them."""
        columns, part = list(columns), self.of(columns)
        weights = self.gram[..., columns] @ (pseudo_inverse(part.gram) if inverse is None else inverse)
        gram = self.gram - weights @ self.gram[..., columns, :]
        towards = self.towards - np.matvec(weights, part.towards)
        if inverse is None:
            gram[..., columns, :], gram[..., columns], towards[..., columns] = 0.0, 0.0, 0.0
        return self._replace(gram=gram, towards=towards)

    def marginal(self, columns: Columns, tau: float | Float[np.ndarray, "*shape 1 1"]) -> "NormalEquations":
        """With random effects of mean zero and standard deviation `tau` on some columns integrated out."""
        part, inverse, log_determinant = self._shrunk(columns, tau)
        squares = np.vecdot(part.towards, np.matvec(inverse, part.towards))
        log_evidence = self.log_evidence + 0.5 * (squares - log_determinant)
        return self.eliminated(columns, inverse)._replace(log_evidence=log_evidence)

    def deviations(self, columns: Columns, tau: float) -> Float[np.ndarray, "*units columns"]:
        """Posterior mean of such random effects (all columns, zero elsewhere)."""
        part, inverse, _ = self._shrunk(columns, tau)
        deviations = np.zeros_like(self.towards)
        deviations[..., list(columns)] = np.matvec(inverse, part.towards)
        return deviations

    def _shrunk(self, columns: Columns, tau: float | np.ndarray) -> tuple["NormalEquations", np.ndarray, np.ndarray]:
        """(I / tau^2 + G)^-1 on some columns, and log|I + tau^2 G|."""
        part = self.of(columns)
        spread = np.eye(len(columns)) + tau**2 * part.gram
        return part, tau**2 * np.linalg.inv(spread), np.linalg.slogdet(spread)[1]

    @property
    def restricted(self) -> Float[np.ndarray, " *units"]:
        """Logarithm of the residual (restricted) likelihood: the coefficients integrated out with a flat prior."""
        squares = np.vecdot(self.towards, np.linalg.solve(self.gram, self.towards[..., None])[..., 0])
        return self.log_evidence + 0.5 * (squares - np.linalg.slogdet(self.gram)[1])

    def heterogeneity(
        self, *groups: Bool[np.ndarray, "choices units"]
    ) -> tuple[Float[np.ndarray, " choices"], Int[np.ndarray, " choices"]]:
        """Cochran's Q of the units within groups that have common coefficients, and its degrees of freedom, for each choice of
        the groups."""
        # A mean of all units changes nothing, but large equal coefficients would cost digits.
        centred, floor = self.given(self.total.solved()), rounding_of(self.gram)
        squares, ranks = explained(centred.gram, centred.towards, floor)
        statistic, dof = np.zeros(len(groups[0])), np.zeros(len(groups[0]), int)
        for group in groups:
            common, rank = explained(np.tensordot(group, centred.gram, 1), group @ centred.towards, floor)
            statistic, dof = statistic + group @ squares - common, dof + group @ ranks - rank
        return np.maximum(statistic, 0.0), dof


def rounding_of(gram: Float[np.ndarray, "*units k k"]) -> float:
    """Information that is none in comparison with the most that any of the units has."""
    return ROUNDING * float(np.max(np.linalg.eigvalsh(gram), initial=1e-300))


def pseudo_inverse(gram: Float[np.ndarray, "*units k k"]) -> Float[np.ndarray, "*units k k"]:
    """Its inverse on the combinations that the data show."""
    values, vectors = np.linalg.eigh(gram)
    shown = values > rounding_of(gram)
    return vectors * np.where(shown, 1.0 / np.where(shown, values, 1.0), 0.0)[..., None, :] @ vectors.mT


def explained(
    gram: Float[np.ndarray, "*shape k k"],
    towards: Float[np.ndarray, "*shape k"],
    floor: float | None = None,
) -> tuple[Float[np.ndarray, " *shape"], Int[np.ndarray, " *shape"]]:
    """Sum of squares that coefficients explain, and their rank; information below `floor` is none, if omitted below the
    rounding of each matrix."""
    values, vectors = np.linalg.eigh(gram)
    largest = np.max(values, axis=-1, keepdims=True, initial=1e-300)
    shown = values > (ROUNDING * largest if floor is None else floor)
    squares = np.where(shown, np.vecmat(towards, vectors) ** 2 / np.where(shown, values, 1.0), 0.0)
    return np.sum(squares, axis=-1), np.sum(shown, axis=-1)


def chi2_p_value(squares: Float[np.ndarray, " *n"], dof: Int[np.ndarray, " *n"]) -> Float[np.ndarray, " *n"]:
    """Probability of sums of squares of so many degrees of freedom, or larger ones, by noise alone; 1 for none."""
    return np.where(dof > 0, gammaincc(np.maximum(dof, 1) / 2, np.maximum(squares, 0.0) / 2), 1.0)
