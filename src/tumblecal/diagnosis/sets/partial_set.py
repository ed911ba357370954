"""Sets of causes to be enlarged, and what each candidate adds to them.

The residual space is projected off a set's blocks, and of a further block the directions are eliminated one by one: each
explains its squared coordinate by what the set and the directions before leave of it. A fault changes the contribution of every
block of the set.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes.table import Moves, Pool
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
    def rest(self) -> Float[np.ndarray, "sets nu"]:
        """What the sets leave of the residual."""
        return self.z - (self.along[:, None] @ self.q)[:, 0]

    @property
    def total(self) -> Float[np.ndarray, " sets"]:
        """The residual's sum of squares."""
        return np.vecdot(self.z, self.z)

    @property
    def segments(self) -> list[slice]:
        """The rows of each block."""
        return [slice(first, last) for first, last in pairwise(accumulate(self.widths))]

    def towards(self, signals: Float[np.ndarray, "signals nu"]) -> Float[np.ndarray, "sets width signals"]:
        """Coordinates of signals along the rows of each set."""
        sets, width, nu = self.q.shape
        return (self.q.reshape(-1, nu) @ signals.T).reshape(sets, width, len(signals))

    def parts(self, squares: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Sum of each block's squared coordinates (sets, width, ...), and its rank in every set."""
        further = (1,) * (squares.ndim - 2)
        return [
            (squares[:, own].sum(axis=1), rank.reshape(-1, *further))
            for own, rank in zip(self.segments, self.ranks.T, strict=True)
        ]

    def log_evidence(self, dof: int, known: bool) -> Float[np.ndarray, " sets"]:
        """Log evidence of each set in a residual space of this dimension."""
        return log_evidence(self.total, self.parts(self.along**2), dof - self.aside, known)

    def only(self, row: int) -> PartialSet:
        """One of the sets."""
        blocks = self.q[row, self.aside :]
        taken = blocks[np.any(blocks != 0.0, axis=1)]
        return PartialSet(self.members[row], self.z[row], taken.T, tuple(self.ranks[row].tolist()))


def nothing(z: Float[np.ndarray, "sets nu"]) -> PartialSets:
    """The empty set, for each of some residuals."""
    return PartialSets([()] * len(z), z, np.zeros((len(z), 0, z.shape[1])), (0,), np.zeros((len(z), 0), int))


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
    left, q = np.repeat(z[None], len(sets), axis=0), np.zeros((len(sets), 0, len(z)))
    for row, member in zip(*((rows >= 0) & np.isin(rows, pool.faults)).nonzero(), strict=True):
        left[row] -= pool.offsets[np.searchsorted(pool.faults, rows[row, member])]
    if asides is not None:
        q, along = asides, asides @ left[:, :, None]
        left = left - (along.mT @ asides)[:, 0]
    # The blocks of each set as rows, filled up with zeros, and their ranks.
    ranks = np.where(rows >= 0, pool.ranks[rows], 0)
    slot = np.arange(ranks.max(initial=0))
    there = slot < ranks[:, :, None]
    columns = np.where(there, pool.first_rows[rows][:, :, None] + slot, 0)
    blocks = pool.rows[columns] * there[:, :, :, None]
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


def added(
    pool: Pool, bases: PartialSets, moves_tried: Sequence[Moves]
) -> Iterator[tuple[Moves, Float[np.ndarray, "width sets moves"], Bool[np.ndarray, "width sets moves"]]]:
    """What each direction of every further candidate, or group of them, explains of what some sets leave, and whether it
    counts."""
    along, overlap = bases.rest @ pool.rows.T, bases.towards(pool.rows)
    for moves in moves_tried:
        # The directions first: all arithmetic is along the moves.
        towards = np.ascontiguousarray(along.take(moves.columns.T, axis=1).swapaxes(0, 1))
        own = overlap.take(moves.columns.T, axis=2) * moves.there.T
        gram = moves.gram.T[:, :, None] - np.einsum("sqim,sqjm->ijsm", own, own)
        explained, counts = np.empty(towards.shape), np.empty(towards.shape, bool)
        for k, pivot in enumerate(np.einsum("kksm->ksm", gram)):
            counts[k] = pivot > COLLINEAR
            scale = counts[k] / np.maximum(pivot, COLLINEAR)
            explained[k] = towards[k] ** 2 * scale
            share = gram[k, k + 1 :] * scale
            towards[k + 1 :] -= towards[k] * share
            gram[k + 1 :, k + 1 :] -= gram[k, k + 1 :, None] * share
        yield moves, explained, counts


def with_each(
    pool: Pool, known: bool, bases: PartialSets, *, groups: bool = False, jointly: bool = False
) -> Float[np.ndarray, "sets further"]:
    """Log evidence of each set with every candidate; -inf where that adds nothing.

    **Arguments:**

    - `groups`: whether the groups of candidates follow. `jointly`: whether the members of a group are one block: they have
      coefficients of one size.
    """
    dof, total = pool.dof - bases.aside, bases.total[:, None]
    tried, further = (pool.group_moves, len(pool.together.groups)) if groups else ([], 0)
    evidence = np.full((len(bases.z), pool.size + further), -np.inf)
    parts = [(part[:, None], rank[:, None]) for part, rank in bases.parts(bases.along**2)]
    for moves, explained, counts in added(pool, bases, [*pool.moves, *tried]):
        own = [(explained.sum(axis=0), counts.sum(axis=0))]
        if not jointly and (several := int(moves.members.max())):
            which = [np.equal(moves.members, member).T[:, None] for member in range(several + 1)]
            own = [((explained * here).sum(axis=0), (counts & here).sum(axis=0)) for here in which]
        score = log_evidence(total, [*parts, *own], dof, known)
        evidence[:, moves.numbers] = np.where(counts.any(axis=0), score, -np.inf)
    if len(pool.faults):
        rest = bases.rest
        overlap = bases.towards(pool.offsets)
        left = np.vecdot(rest, rest)[:, None] - 2 * rest @ pool.offsets.T + pool.offset_squares
        left = np.maximum(left - (overlap**2).sum(axis=1), 0.0)
        undone = bases.parts((bases.along[:, :, None] - overlap) ** 2)
        evidence[:, pool.faults] = log_evidence(left + sum(part for part, _ in undone), undone, dof, known)
    return evidence
