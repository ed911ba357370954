"""The parameters that a design determines: SVD of the scaled Jacobian, with its weak directions in words."""

from collections.abc import Set
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from pydantic import computed_field
from scipy.linalg.lapack import dtrcon  # type: ignore[attr-defined]

from tumblecal.data.sensor_parameters import leaf_of
from tumblecal.estimation.attitudes import attitude_words
from tumblecal.ground.errors import InputError


# A singular value below this share of the largest counts as zero: exact degeneracies give 1e-15, the paper's weakest true
# direction 4e-2.
RANK_TOLERANCE = 1e-9
# A direction is called weak when its standard deviation exceeds the median parameter's by this factor.
WEAK_FACTOR = 3.0
# From this factor on it counts as practically undetermined.
NEARLY_SINGULAR = 100.0


@dataclass(frozen=True)
class Direction:
    """A combination of parameters whose largest coefficient is one; `sd_ratio`: its sd over that of the median direction."""

    coefficients: dict[str, float]
    sd_ratio: float

    @computed_field
    @property
    def words(self) -> str:
        """The combination as a formula."""
        return formula(self.coefficients)


def formula(weights: dict[str, float]) -> str:
    """A combination in words: `a - 0.5 b`."""
    terms = []
    for place, (name, share) in enumerate(weights.items()):
        sign = ("" if place == 0 else "+ ") if share > 0 else ("-" if place == 0 else "- ")
        size = "" if abs(abs(share) - 1) < 0.005 else f"{abs(share):.2g} "
        terms.append(f"{sign}{size}{name}")
    return " ".join(terms)


@dataclass(frozen=True)
class Identifiability:
    """Rank of a design, the undetermined directions (`unobservable`) and the poorly determined ones (`weak`)."""

    rank: int
    free: int
    singular_values: Float[np.ndarray, " free"]
    unobservable: tuple[Direction, ...]
    undetermined: tuple[str, ...]
    weak: tuple[Direction, ...]
    hand_held: bool = False

    @property
    def nearly_singular(self) -> bool:
        """Whether some direction is so weak that its value has no meaning."""
        return bool(self.nearly_undetermined)

    @property
    def nearly_undetermined(self) -> tuple[Direction, ...]:
        """The directions that are practically undetermined, the weakest first."""
        return tuple(direction for direction in self.weak if direction.sd_ratio > NEARLY_SINGULAR)

    def require_full_rank(self, source: str, readings: Float[np.ndarray, "positions 3"] | None = None) -> None:
        """Reject a design with undetermined directions.

        **Arguments:**

        - `source`: named in the message. `readings`: of a hand-held set, g, for the attitudes to measure next.

        **Raises:** `InputError` that names the directions and the remedies.
        """
        if not self.unobservable:
            return
        shown = "; ".join(direction.words for direction in self.unobservable)
        remedy = (
            "Measure at more pitch settings or spindle angles, fix a parameter (--fix dbeta), state a prior on it "
            "(--prior 'dbeta=3 arcmin'), or state that the attitudes were set by hand (--attitudes hand)"
        )
        if self.hand_held:
            alone = {leaf_of(name) for direction in self.unobservable for name in direction.coefficients} == {"gamma"}
            fixed = (
                "; faces alone determine bias and scale factor if the non-orthogonality is fixed at zero: --fix gamma"
            )
            remedy = (
                "The attitudes are unknown, so each position determines one number, the size of gravity: measure in nine or "
                "more attitudes that differ in all directions, or give alpha_deg and beta_deg if they are known"
                f"{fixed * alone}" + ("" if readings is None else f". Next: {attitude_words(readings)}")
            )
        changes = sorted({leaf_of(name) for name in self.undetermined if leaf_of(name).endswith("_T")})
        if changes:
            followed = " and ".join(leaf.removesuffix("_T") for leaf in changes)
            shown += f" ({' and '.join(changes)}: {followed} over temperature)"
            remedy = f"Lower the order of {followed} in [temperature]. {remedy}"
        raise InputError(
            f"{source}: these positions cannot determine {', '.join(self.undetermined)}: {self.free} parameters, but "
            f"rank {self.rank}. Free to move without changing any reading: {shown}. {remedy}"
        )


def identifiability(
    jacobian: Float[np.ndarray, "rows free"],
    names: tuple[str, ...],
    scales: Float[np.ndarray, " free"],
    of_positions: Set[str] = frozenset(),
) -> Identifiability:
    """SVD rank test of a design.

    **Arguments:**

    - `jacobian`: weighted residuals by scaled parameters (priors' rows included).
    - `names`, `scales`: of the parameters.
    - `of_positions`: those that belong to one position each; they are eliminated, and no direction includes them.

    **Returns:** rank, null directions in a sparse basis, weak directions.
    """
    if of_positions:
        of_position = np.array([name in of_positions for name in names])
        q, _ = np.linalg.qr(jacobian[:, of_position])
        rest = jacobian[:, ~of_position] - q @ (q.T @ jacobian[:, ~of_position])
        shared = identifiability(rest, tuple(name for name in names if name not in of_positions), scales[~of_position])
        return replace(shared, rank=shared.rank + len(of_positions), free=len(names), hand_held=True)
    free = jacobian.shape[1]
    padded = np.vstack([jacobian, np.zeros((max(0, free - len(jacobian)), free))])
    _, singular, right = np.linalg.svd(padded, full_matrices=False)
    rank = int(np.sum(singular > RANK_TOLERANCE * singular[0])) if free else 0
    null = sparse_basis(right[rank:].T) * scales[:, None]
    undetermined = tuple(
        name for name, row in zip(names, null, strict=True) if np.any(np.abs(row) > 1e-6 * scales.max())
    )
    inverse = np.divide(1.0, singular, out=np.full(free, np.inf), where=singular > 0)
    ratio = inverse / np.median(inverse[:rank]) if rank else inverse
    weak = [place for place in range(rank - 1, -1, -1) if ratio[place] > WEAK_FACTOR]
    return Identifiability(
        rank=rank,
        free=free,
        singular_values=singular,
        unobservable=tuple(_direction(column, names, np.inf) for column in null.T),
        undetermined=undetermined,
        weak=tuple(_direction(right[place] * scales, names, float(ratio[place])) for place in weak),
    )


def surely_full_rank(triangle: Any) -> bool:
    """Whether a design clearly determines all parameters, from the triangle (free, free) of its QR decomposition.

    An estimate of the condition number takes a tenth of the time of the singular values.
    """
    return bool(dtrcon(triangle)[0] > 1e3 * RANK_TOLERANCE)


def _direction(vector: np.ndarray, names: tuple[str, ...], sd_ratio: float) -> Direction:
    """The direction of a vector: the entries above a fifth of the largest, with the first one positive."""
    largest = np.max(np.abs(vector))
    large = np.nonzero(np.abs(vector) > 0.2 * largest)[0]
    unit = largest * np.sign(vector[large[0]])
    return Direction({names[place]: float(vector[place] / unit) for place in large}, sd_ratio)


def sparse_basis(basis: Float[np.ndarray, "free null"]) -> Float[np.ndarray, "free null"]:
    """The same space spanned by vectors with as many zeros as elimination gives (reduced echelon form)."""
    basis = basis.copy()
    rows = list(range(len(basis)))
    for column in range(basis.shape[1]):
        pivot = max(rows, key=lambda row: abs(basis[row, column:]).max())
        rows.remove(pivot)
        swap = column + int(np.argmax(np.abs(basis[pivot, column:])))
        basis[:, [column, swap]] = basis[:, [swap, column]]
        basis[:, column] /= basis[pivot, column]
        for other in range(basis.shape[1]):
            if other != column:
                basis[:, other] -= basis[pivot, other] * basis[:, column]
    basis[np.abs(basis) < 1e-9] = 0.0
    return basis
