"""Normal equations of units, and the likelihoods of the linear mixed model in closed form (equations: `units`)."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import gammaincc


# Directions of information below this share of the largest contain only rounding errors.
ROUNDING = 1e-9

Columns = Sequence[int] | Int[np.ndarray, " columns"]


class NormalEquations(NamedTuple):
    """Of linear coefficients, for one unit or, with a leading axis, for many.

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
        return NormalEquations(*(np.sum(part, axis=0) for part in self))

    def of(self, columns: Columns) -> "NormalEquations":
        """Of some coefficients, the others being zero."""
        columns = list(columns)
        return self._replace(gram=self.gram[..., columns, :][..., columns], towards=self.towards[..., columns])

    def given(self, coefficients: Float[np.ndarray, "*units columns"]) -> "NormalEquations":
        """Of the differences from these coefficients."""
        return self._replace(towards=self.towards - np.matvec(self.gram, coefficients))

    def solved(self) -> Float[np.ndarray, "*units columns"]:
        """Least-squares estimates; 0 for combinations that the data do not show."""
        return np.matvec(pseudo_inverse(self.gram), self.towards)

    def eliminated(self, columns: Columns, inverse: Float[np.ndarray, "*units k k"] | None = None) -> "NormalEquations":
        """With some coefficients estimated in every unit, of which nothing is left then, or with this inverse of the
        information on them."""
        columns, part, across = list(columns), self.of(columns), self.gram[..., :, list(columns)]
        weights = across @ (pseudo_inverse(part.gram) if inverse is None else inverse)
        gram, towards = self.gram - weights @ across.mT, self.towards - np.matvec(weights, part.towards)
        if inverse is None:
            gram[..., columns, :], gram[..., columns], towards[..., columns] = 0.0, 0.0, 0.0
        return self._replace(gram=gram, towards=towards)

    def marginal(self, columns: Columns, tau: float) -> "NormalEquations":
        """With random effects of mean zero and standard deviation `tau` on some columns integrated out."""
        part = self.of(columns)
        precision = part.gram + np.eye(len(columns)) / tau**2
        inverse = np.linalg.inv(precision)
        squares = np.vecdot(part.towards, np.matvec(inverse, part.towards))
        log_evidence = self.log_evidence + 0.5 * (squares - np.linalg.slogdet(precision * tau**2)[1])
        return self.eliminated(columns, inverse)._replace(log_evidence=log_evidence)

    def deviations(self, columns: Columns, tau: float) -> Float[np.ndarray, "*units columns"]:
        """Posterior mean of such random effects (all columns, zero elsewhere)."""
        part, deviations = self.of(columns), np.zeros_like(self.towards)
        precision = part.gram + np.eye(len(columns)) / tau**2
        deviations[..., list(columns)] = np.linalg.solve(precision, part.towards[..., None])[..., 0]
        return deviations

    def heterogeneity(
        self, *groups: Bool[np.ndarray, "choices units"]
    ) -> tuple[Float[np.ndarray, " choices"], Int[np.ndarray, " choices"]]:
        """Cochran's Q of the units within groups that have common coefficients, and its degrees of freedom, for each choice of
        the groups."""
        # A mean of all units changes nothing, but large equal coefficients would cost digits.
        centred = self.given(self.total.solved())
        floor = rounding_of(self.gram)
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


class Profile(NamedTuple):
    """Marginal likelihood at one standard deviation of the random effects: its logarithm about a mean of zero, and the normal
    equations of the mean."""

    about_zero: Float[np.ndarray, "*effects draws"]
    gram: Float[np.ndarray, "*effects k k"]
    towards: Float[np.ndarray, "*effects draws k"]

    @property
    def restricted(self) -> Float[np.ndarray, "*effects draws"]:
        """Logarithm of the residual (restricted) likelihood."""
        squares = np.vecdot(self.towards, np.linalg.solve(self.gram, self.towards.mT).mT)
        return self.about_zero + 0.5 * (squares - np.linalg.slogdet(self.gram)[1][..., None])


def profiles(
    gram: Float[np.ndarray, "*effects units k k"],
    towards: Float[np.ndarray, "*effects draws units k"],
    taus: Float[np.ndarray, "spreads ..."],
) -> Iterator[Profile]:
    """The marginal likelihood at each standard deviation, for effects of k coefficients and many sets of data."""
    values, vectors = np.linalg.eigh(gram)
    flat = (*gram.shape[:-3], -1)
    along = (towards.swapaxes(-3, -2) @ vectors).swapaxes(-3, -2).reshape(*towards.shape[:-2], -1)
    values, axes = np.maximum(values, 0.0).reshape(flat), vectors.mT.reshape(*flat, gram.shape[-1])
    for tau in taus:
        variance = np.square(tau)[..., None]
        shrunk = 1.0 / (1.0 + variance * values)
        about_zero = variance * np.matvec(along**2, shrunk) + np.sum(np.log(shrunk), axis=-1)[..., None]
        weighted = shrunk[..., None] * axes
        yield Profile(0.5 * about_zero, axes.mT @ (values[..., None] * weighted), along @ weighted)
