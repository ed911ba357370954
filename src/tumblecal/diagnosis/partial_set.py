"""Sets of causes to be enlarged: what each leaves, and the evidence of each with every further cause."""

from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.causes import Cause
from tumblecal.diagnosis.evidence import log_evidence
from tumblecal.diagnosis.pool import Pool
from tumblecal.diagnosis.tuning import COLLINEAR


@dataclass(frozen=True)
class PartialSet:
    """A set to be enlarged: residual after its faults are undone, orthonormal basis and segments of its blocks.

    The first `aside` directions of the basis are those of readings that take no part; the residual has nothing along them.
    """

    members: tuple[int, ...]
    z: Float[np.ndarray, " nu"]
    q: Float[np.ndarray, "nu rank"]
    segments: tuple[int, ...]
    aside: int = 0

    @property
    def left(self) -> float:
        """Sum of squares that the set leaves."""
        return float(max(self.z @ self.z - np.sum((self.q.T @ self.z) ** 2), 0.0))

    def explained(self, along: Float[np.ndarray, " rank"]) -> list[tuple[np.ndarray, int | np.ndarray]]:
        """What each block explains, from the coordinates along the basis, and its rank."""
        ends = list(accumulate(self.segments, initial=self.aside))
        return [(np.array(np.sum(along[a:b] ** 2)), b - a) for a, b in pairwise(ends) if b > a]


def partial_set(
    pool: Pool, z: Float[np.ndarray, " nu"], members: tuple[int, ...], aside: Float[np.ndarray, "nu out"] | None = None
) -> PartialSet:
    """Residual and basis of a set, its faults undone first, then its blocks in turn by what they explain.

    **Arguments:**

    - `aside`: orthonormal directions of readings that take no part.
    """
    q, segments = np.zeros((len(z), 0)) if aside is None else aside, []
    causes = [pool.causes[k] for k in members]
    for cause in causes:
        if cause.offset is not None:
            z = z - cause.offset
    if aside is not None:
        z = z - aside @ (aside.T @ z)
    # The largest first: of two that are nearly collinear, what the second adds may count as nothing.
    for cause in sorted(causes, key=lambda cause: _size_along(cause, z)):
        if cause.block is None:
            continue
        rest = cause.block - q @ (q.T @ cause.block) if q.shape[1] else cause.block
        if rest.shape[1] == 1:
            size = np.linalg.norm(rest)
            new = rest / size if size**2 > COLLINEAR else rest[:, :0]
        else:
            left, singular, _ = np.linalg.svd(rest, full_matrices=False)
            new = left[:, singular**2 > COLLINEAR]
        q, segments = np.hstack([q, new]), [*segments, new.shape[1]]
    return PartialSet(members, z, q, tuple(segments), 0 if aside is None else aside.shape[1])


def evidence_of_each(pool: Pool, known: bool, bases: list[PartialSet]) -> Float[np.ndarray, " bases"]:
    """Log evidence of each set. All sets have as many directions aside."""
    z = np.stack([base.z for base in bases])
    along = np.einsum("bvw,bv->bw", _stacked(bases), z)
    explained, ranks = _parts(bases, along[:, :, None])
    parts = [(explained[:, k, 0], ranks[:, k]) for k in range(ranks.shape[1])]
    return log_evidence(np.sum(z**2, axis=1), parts, pool.dof - bases[0].aside, known)


def evidence_with_each(pool: Pool, known: bool, bases: list[PartialSet]) -> Float[np.ndarray, "bases causes"]:
    """Log evidence of each set with every further cause; -inf where that adds nothing. All sets have as many directions
    aside."""
    scores = np.full((len(bases), len(pool.causes)), -np.inf)
    z, q = np.stack([base.z for base in bases]), _stacked(bases)
    _with_blocks(pool, known, bases, z, q, scores)
    _with_faults(pool, known, bases, z, q, scores)
    return scores


def _with_blocks(
    pool: Pool, known: bool, bases: list[PartialSet], z: np.ndarray, q: np.ndarray, scores: np.ndarray
) -> None:
    along = np.einsum("bvw,bv->bw", q, z)
    projected = (z - np.einsum("bvw,bw->bv", q, along)) @ pool.stacked
    overlap = (np.swapaxes(q, 1, 2).reshape(-1, pool.dof) @ pool.stacked).reshape(
        len(bases), q.shape[2], pool.stacked.shape[1]
    )
    explained_before, ranks_before = _parts(bases, along[:, :, None])
    total = np.broadcast_to(np.sum(z**2, axis=1)[:, None], (len(bases), len(pool.causes)))
    explained, effective = np.zeros(total.shape), np.zeros(total.shape, np.int64)
    for rank, (indices, columns) in pool.by_rank.items():
        if rank:
            own = _explained(projected[:, columns], overlap[:, :, columns], rank)
            explained[:, indices], effective[:, indices] = own
    parts = [(explained_before[:, k], ranks_before[:, k, None]) for k in range(ranks_before.shape[1])]
    score = log_evidence(total, [*parts, (explained, effective)], pool.dof - bases[0].aside, known)
    scores[effective > 0] = score[effective > 0]


def _with_faults(
    pool: Pool, known: bool, bases: list[PartialSet], z: np.ndarray, q: np.ndarray, scores: np.ndarray
) -> None:
    if not len(pool.faults):
        return
    overlap = (np.swapaxes(q, 1, 2).reshape(-1, pool.dof) @ pool.offsets).reshape(
        len(bases), q.shape[2], len(pool.faults)
    )
    totals = np.sum(z**2, axis=1)[:, None] - 2 * z @ pool.offsets + pool.offset_squares
    along = np.einsum("bvw,bv->bw", q, z)[:, :, None] - overlap
    out = bases[0].aside
    totals = totals - np.sum(along[:, :out] ** 2, axis=1)
    explained, ranks = _parts(bases, along)
    parts = [(explained[:, k], ranks[:, k, None]) for k in range(ranks.shape[1])]
    scores[:, pool.faults] = log_evidence(totals, parts, pool.dof - out, known)


def _size_along(cause: Cause, z: Float[np.ndarray, " nu"]) -> float:
    """Less than nothing by what a cause explains alone."""
    return 0.0 if cause.block is None else -float(np.sum((cause.block.T @ z) ** 2))


def _stacked(bases: list[PartialSet]) -> Float[np.ndarray, "bases nu width"]:
    """The bases of all sets, filled up with zeros."""
    q = np.zeros((len(bases), len(bases[0].z), max(base.q.shape[1] for base in bases)))
    for row, base in enumerate(bases):
        q[row, :, : base.q.shape[1]] = base.q
    return q


def _parts(
    bases: list[PartialSet], along: Float[np.ndarray, "bases width columns"]
) -> tuple[Float[np.ndarray, "bases blocks columns"], Int[np.ndarray, "bases blocks"]]:
    """What each block of each base explains of several residuals, and its rank, zero where a base has fewer blocks."""
    most = max(len(base.segments) for base in bases)
    member, ranks = np.zeros((len(bases), most, along.shape[1])), np.zeros((len(bases), most), np.int64)
    for row, base in enumerate(bases):
        for k, (start, stop) in enumerate(pairwise(accumulate(base.segments, initial=base.aside))):
            member[row, k, start:stop], ranks[row, k] = 1.0, stop - start
    return member @ along**2, ranks


def _explained(
    projected: Float[np.ndarray, "bases candidates rank"],
    overlap: Float[np.ndarray, "bases width candidates rank"],
    rank: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Sum of squares that each candidate adds beside each base, and the rank that it adds."""
    if rank == 1:
        left = 1.0 - np.sum(overlap[..., 0] ** 2, axis=1)
        free = left > COLLINEAR
        return np.divide(projected[..., 0] ** 2, left, out=np.zeros(left.shape), where=free), free.astype(np.int64)
    if overlap.shape[1] == 0:
        return np.sum(projected**2, axis=-1), np.full(projected.shape[:2], rank)
    gram = np.eye(rank) - np.einsum("bwci,bwcj->bcij", overlap, overlap)
    with np.errstate(over="ignore", invalid="ignore"):
        # What adds next to nothing grows beyond all bounds; it is found again below.
        explained, volume = _along_all(gram, projected)
    ranks = np.full(volume.shape, rank)
    # No eigenvalue exceeds one, so none is below the volume (their product): eigenvalues are needed only where that is small.
    thin = np.nonzero(~(volume > COLLINEAR))
    values, vectors = np.linalg.eigh(gram[thin])
    free = values > COLLINEAR
    turned = np.einsum("cij,ci->cj", vectors, projected[thin])
    explained[thin] = np.sum(np.divide(turned**2, values, out=np.zeros_like(values), where=free), axis=-1)
    ranks[thin] = np.sum(free, axis=-1)
    return explained, ranks


def _along_all(
    gram: Float[np.ndarray, "bases candidates rank rank"], projected: Float[np.ndarray, "bases candidates rank"]
) -> tuple[Float[np.ndarray, "bases candidates"], Float[np.ndarray, "bases candidates"]]:
    """`projected` squared by the inverse of each Gram matrix, and the determinants, by Cholesky's elimination."""
    explained, volume = np.zeros(gram.shape[:2]), np.ones(gram.shape[:2])
    while projected.shape[-1]:
        pivot = np.maximum(gram[..., 0, 0], 1e-12)
        first, row = projected[..., 0] / pivot, gram[..., 0, 1:]
        explained, volume = explained + first * projected[..., 0], volume * pivot
        projected = projected[..., 1:] - first[..., None] * row
        gram = gram[..., 1:, 1:] - row[..., :, None] * (row / pivot[..., None])[..., None, :]
    return explained, volume
