"""The residual of a fit in the space that its parameters do not reach, and the response of that space to single readings."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import gammaincc

from tumblecal.diagnosis.priors import VISIBLE_TERM
from tumblecal.estimation.fit import Fit
from tumblecal.full_model.tangent import unreachable
from tumblecal.ground.showing import brief


# A direction counts if more than this share of the largest remains.
_SEEN = 1e-6
# Square of a norm, of the largest one, that is rounding; numbers of one array.
_ROUNDING, _NUMBERS_AT_ONCE = 1e-18, 4_000_000


@dataclass(frozen=True)
class ResidualSpace:
    """The residual of a fit in the space that it cannot reach.

    - `z`: the residual there, in units of the stated noise, or in mg. `responses`: of a unit change (g) of each reading.
    - `known`: whether the noise is stated.
    """

    __repr__ = brief

    z: Float[np.ndarray, " nu"]
    responses: Float[np.ndarray, "nu positions 3"]
    known: bool

    @classmethod
    def of(cls, fit: Fit) -> "ResidualSpace":
        """Residual of a fit, without excluded positions."""
        count = fit.residuals.size
        takes_part = np.ones(len(fit.rows), bool)
        takes_part[:count] = np.repeat(fit.retained, 3)
        basis_of_part, _ = unreachable(fit.jacobian[takes_part])
        basis = np.zeros((len(fit.rows), basis_of_part.shape[1]))
        basis[takes_part] = basis_of_part
        rows, whitening = basis[:count], np.asarray(fit.problem.whitening)
        unwhitened = rows * whitening[:, None] if whitening.ndim == 1 else fit.problem.whitening_matrix.T @ rows
        return cls(basis.T @ fit.rows, unwhitened.T.reshape(basis.shape[1], -1, 3), fit.problem.known)

    @property
    def dof(self) -> int:
        """Dimension of the space."""
        return len(self.z)

    @property
    def squares(self) -> float:
        """Sum of squares of the residual."""
        return float(self.z @ self.z)

    @property
    def variance(self) -> float:
        """Of the noise, in the units of `z`: 1 if it is stated, otherwise estimated from the residual."""
        return 1.0 if self.known else self.squares / max(self.dof, 1)

    @property
    def p_value(self) -> float | None:
        """Probability of residuals this large without further errors; None if the noise is not stated."""
        return float(gammaincc(self.dof / 2, self.squares / 2)) if self.known and self.dof else None

    def log_gain(self, explained: Float[np.ndarray, " signals"]) -> Float[np.ndarray, " signals"]:
        """Twice the log likelihood ratio of signals that explain these sums of squares."""
        if self.known:
            return explained
        return -self.dof * np.log(np.maximum(1.0 - explained / self.squares, 1e-12))

    def without(self, columns: Float[np.ndarray, "nu columns"]) -> "ResidualSpace":
        """The residual in the space that these columns do not reach either."""
        basis, _ = unreachable(columns)
        return replace(self, z=basis.T @ self.z, responses=np.tensordot(basis.T, self.responses, 1))

    def of_positions(self, positions: Bool[np.ndarray, " positions"]) -> Float[np.ndarray, "nu readings"]:
        """Response to the readings of some positions, position by position."""
        return self.responses[:, positions].reshape(self.dof, -1)

    def predicted_errors(
        self, positions: Bool[np.ndarray, " positions"], law: Float[np.ndarray, "nu terms"] | None = None
    ) -> tuple[Float[np.ndarray, "held_out 3"], Float[np.ndarray, "held_out 3"]]:
        """Measured minus predicted at some positions from all others, g, and its standard uncertainty by the noise.

        **Arguments:**

        - `law`: signals that are fitted to the others as well.
        """
        readings = self.of_positions(positions)
        whole = readings if law is None else np.hstack([readings, law])
        sizes = np.linalg.norm(whole, axis=0)
        scale = np.where(sizes > 0, sizes, 1.0)
        vectors, singular, right = np.linalg.svd(whole / scale, full_matrices=False)
        seen = singular > _SEEN * singular[0]
        inverse = (right[seen].T / singular[seen]) / scale[:, None]
        values, spread = inverse @ (vectors[:, seen].T @ self.z), np.linalg.norm(inverse, axis=1)
        spread[sizes == 0] = np.inf  # a position that the fit excludes
        count, residual = readings.shape[1], self.z - whole @ values
        level = 1.0 if self.known else np.linalg.norm(residual) / np.sqrt(max(self.dof - seen.sum(), 1))
        return values[:count].reshape(-1, 3), level * spread[:count].reshape(-1, 3)


def log_odds(
    space: ResidualSpace,
    values: Float[np.ndarray, "signals functions positions"],
    responses: Float[np.ndarray, "places nu positions"],
    together: Collection[Sequence[int]],
) -> Float[np.ndarray, "together signals"]:
    """Twice the log odds of signals against none (BIC), with a coefficient for each function at each place.

    **Arguments:**

    - `values`: of the functions of each signal. `responses`: of the space to one unit at every position, by place.
    - `together`: the places at which a signal acts, one row of the odds for each.
    """
    sizes = values**2 @ np.sum(responses**2, axis=1).T
    # Functions that act at excluded positions only are rounding.
    least = np.maximum(VISIBLE_TERM**2 * sizes, _ROUNDING * np.max(sizes, axis=(0, 1), initial=0.0))
    parts, listed = 1 + values.shape[0] * values.shape[1] * responses[..., 0].size // _NUMBERS_AT_ONCE, []
    for some, bound in zip(np.array_split(values, parts), np.array_split(least, parts), strict=True):
        every, odds = np.tensordot(some, responses, (2, 2)), []
        every *= (np.vecdot(every, every) > bound)[..., None]
        for places in together:
            rows = every[:, :, list(places)].reshape(len(some), -1, len(space.z))
            explained, rank = explained_by(rows @ rows.mT, rows @ space.z)
            odds.append(space.log_gain(explained) - rank * np.log(space.responses[0].size))
        listed.append(np.stack(odds))
    return np.concatenate(listed, axis=1)


def explained_by(
    gram: Float[np.ndarray, "signals columns columns"], towards: Float[np.ndarray, "signals columns"]
) -> tuple[Float[np.ndarray, " signals"], Int[np.ndarray, " signals"]]:
    """The sum of squares that signals of several columns explain, and their rank.

    **Arguments:**

    - `gram`: Gram matrices of the columns. `towards`: their products with the residual.
    """
    norms = np.sqrt(np.maximum(np.diagonal(gram, axis1=1, axis2=2), 0.0))
    scale = np.divide(1.0, norms, out=np.zeros_like(norms), where=norms > 0)
    values, vectors = np.linalg.eigh(gram * scale[:, :, None] * scale[:, None])
    along = (vectors.mT @ (towards * scale)[:, :, None])[:, :, 0]
    seen = values > VISIBLE_TERM**2
    return np.sum(np.divide(along**2, values, out=np.zeros_like(along), where=seen), axis=1), seen.sum(axis=1)
