"""Sets of causes to be enlarged: their residuals and the directions of their blocks."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.priors import COLLINEAR
from tumblecal.diagnosis.sets.cause_sets import rows_of
from tumblecal.full_model.evidence import log_evidence


@dataclass(frozen=True)
class PartialSet:
    """A set to be enlarged: residual after its faults are undone, orthonormal basis and segments of its blocks.

    The residual has nothing along directions that were set aside.
    """

    members: tuple[int, ...]
    z: Float[np.ndarray, " nu"]
    q: Float[np.ndarray, "nu rank"]
    segments: tuple[int, ...]

    @property
    def left(self) -> float:
        """Sum of squares that the set leaves."""
        along = self.q.T @ self.z
        return max(float(self.z @ self.z - along @ along), 0.0)

    def explained(self, along: Float[np.ndarray, " rank *noises"]) -> list[tuple[Float[np.ndarray, " *noises"], int]]:
        """Sum of squares that each block explains, from the coordinates along the basis, and its rank."""
        ends = accumulate(self.segments, initial=0)
        return [(np.asarray(np.sum(along[a:b] ** 2, axis=0)), b - a) for a, b in pairwise(ends) if b > a]


@dataclass(frozen=True)
class PartialSets:
    """Sets to be enlarged, as arrays.

    - `z`: the residual after each set's faults are undone, without its part along the excluded directions.
    - `q`: orthonormal rows: the directions of excluded readings, then those of the blocks in turn.
    - `widths`: number of rows for the excluded directions, to the first block, to the second ...: as many as any of the sets
      needs, rows of zeros in the others. `ranks`: how many each block of each set has.
    """

    members: Sequence[tuple[int, ...]]
    z: Float[np.ndarray, "sets nu"]
    q: Float[np.ndarray, "sets width nu"]
    widths: tuple[int, ...]
    ranks: Int[np.ndarray, "sets blocks"]

    @property
    def aside(self) -> int:
        """Number of directions set aside, the same for all."""
        return self.widths[0]

    @cached_property
    def along(self) -> Float[np.ndarray, "sets width"]:
        """The residual's coordinates along the rows."""
        return (self.q @ self.z[:, :, None])[:, :, 0]

    @cached_property
    def total(self) -> Float[np.ndarray, " sets"]:
        """The residual's sum of squares."""
        return np.vecdot(self.z, self.z)

    @property
    def segments(self) -> list[slice]:
        """The rows of each block."""
        return [slice(first, last) for first, last in pairwise(accumulate(self.widths))]

    @cached_property
    def explained(self) -> Float[np.ndarray, "sets blocks"]:
        """Sum of squares that each block explains, in turn."""
        explained = np.zeros((len(self.z), len(self.segments)))
        for number, own in enumerate(self.segments):
            explained[:, number] = np.vecdot(self.along[:, own], self.along[:, own])
        return explained

    def log_evidence(self, dof: int, known: bool) -> Float[np.ndarray, " sets"]:
        """Log evidence of each set in a residual space of this dimension."""
        return log_evidence(self.total, list(zip(self.explained.T, self.ranks.T, strict=True)), dof - self.aside, known)

    def only(self, row: int) -> PartialSet:
        """One of the sets."""
        blocks = self.q[row, self.aside :]
        taken = blocks[np.any(blocks != 0.0, axis=1)]
        return PartialSet(self.members[row], self.z[row], taken.T, tuple(self.ranks[row].tolist()))


def partial_sets(
    pool: Pool,
    z: Float[np.ndarray, " nu"],
    sets: Sequence[tuple[int, ...]],
    asides: Float[np.ndarray, "sets out nu"] | None = None,
) -> PartialSets:
    """Residual and basis of each set, its faults undone first, then its blocks in turn by what they explain.

    **Arguments:**

    - `asides`: for each set orthonormal directions of excluded readings, as rows.
    """
    rows = rows_of(sets, max(map(len, sets)))
    left, q = _without_faults(pool, z, rows), np.zeros((len(sets), 0, len(z)))
    if asides is not None:
        q, along = asides, asides @ left[:, :, None]
        left = left - (along.mT @ asides)[:, 0]
    # The blocks of each set as rows, filled up with zeros, and their ranks.
    ranks = np.where(rows >= 0, pool.ranks[rows], 0)
    slot = np.arange(ranks.max(initial=0))
    there = slot < ranks[:, :, None]
    columns = np.where(there, pool.first_columns[rows][:, :, None] + slot, 0)
    blocks = pool.stacked.T[columns] * there[:, :, :, None]
    # The largest first: of two that are nearly collinear, what the second adds may count as nothing.
    along = (blocks @ left[:, None, :, None])[..., 0]
    turn = np.arange(len(sets))[:, None], (-np.vecdot(along, along)).argsort(axis=1, kind="stable")
    blocks, ranks = blocks[turn], ranks[turn]
    widths, kept = [q.shape[1]], []
    for number, width in enumerate(ranks.max(axis=0, initial=0).tolist()):
        if width:
            block = blocks[:, number, :width]
            new, rank = _orthonormal(block - (block @ q.mT) @ q)
            q = np.concatenate([q, new], axis=1)
            widths.append(width)
            kept.append(rank)
    taken = np.stack(kept, axis=1) if kept else np.zeros((len(sets), 0), int)
    return PartialSets(sets, left, q, tuple(widths), taken)


def least_left(
    pool: Pool, z: Float[np.ndarray, " nu"], sets: Int[np.ndarray, "sets most"]
) -> tuple[Float[np.ndarray, " sets"], Int[np.ndarray, "sets most"]]:
    """Lower bound of the residual of sets of effects (rows that end in -1), by normal equations, and the ranks of their
    blocks."""
    ranks = np.where(sets >= 0, pool.ranks[sets], 0)
    number = np.arange(ranks.max())
    there = (number < ranks[:, :, None]).reshape(len(sets), -1)
    columns = np.where(there, (pool.first_columns[sets][:, :, None] + number).reshape(there.shape), 0)
    used, place = np.unique(columns, return_inverse=True)
    rows, place = pool.stacked.T[used], place.reshape(columns.shape)
    along, gram = (rows @ z)[place] * there, (rows @ rows.T)[place[:, :, None], place[:, None]]
    # For nearly collinear directions the apparent explained part is too large: the remainder is a bound.
    gram = gram * (there[:, :, None] & there[:, None]) + 1e-9 * np.eye(there.shape[1])
    explained = np.vecdot(along, np.linalg.solve(gram, along[:, :, None])[:, :, 0])
    return np.maximum(z @ z * (1 - 1e-6) - explained, 0.0), ranks


def _without_faults(pool: Pool, z: np.ndarray, sets: Int[np.ndarray, "sets most"]) -> Float[np.ndarray, "sets nu"]:
    """The residual when the faults of each set are undone."""
    left = np.repeat(z[None], len(sets), axis=0)
    there = (sets >= 0) & pool.is_fault[sets]
    if there.any():
        for row, member in zip(*there.nonzero(), strict=True):
            left[row] -= pool.offsets[:, np.searchsorted(pool.faults, sets[row, member])]
    return left


def _orthonormal(
    rest: Float[np.ndarray, "sets width nu"],
) -> tuple[Float[np.ndarray, "sets width nu"], Int[np.ndarray, " sets"]]:
    """Orthonormal rows that span the remainder of each block, zeros for directions with a negligible remainder, and their
    number."""
    if rest.shape[1] == 1:
        values, turned = np.vecdot(rest, rest), rest
    else:
        values, vectors = np.linalg.eigh(rest @ rest.mT)
        turned = vectors.mT @ rest
    free = values > COLLINEAR
    scale = np.divide(1.0, np.sqrt(np.maximum(values, COLLINEAR)), out=np.zeros_like(values), where=free)
    return turned * scale[:, :, None], free.sum(axis=1)
