"""Sets of causes with one cause more: the evidence of each, or what it does not exceed.

The residual space is projected off a set's blocks. A further block of one direction then explains its coordinate squared, over
what is left of the direction. One of several directions takes a Gram matrix of its own for each set, and a fault changes what
every block of the set explains: these are computed where a bound shows that they can matter, which few can.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.evidence import log_evidence, log_evidence_at_most, log_evidence_of_noise, shortfall
from tumblecal.diagnosis.partial_set import PartialSets
from tumblecal.diagnosis.pool import Pool
from tumblecal.diagnosis.tuning import COLLINEAR


class Enlarged:
    """Sets with every cause of a pool.

    - `evidence` (sets, causes): log evidence of each set with each cause; -inf where that adds nothing.
    - `open` (sets, causes): where it stands for what the evidence does not exceed, until `settle` computes it.
    """

    def __init__(self, pool: Pool, known: bool, bases: PartialSets):
        self._pool, self._known, self._bases, self._dof = pool, known, bases, pool.dof - bases.aside
        self.evidence: Float[np.ndarray, "sets causes"] = np.full((len(bases.z), len(pool.causes)), -np.inf)
        self.open: Bool[np.ndarray, "sets causes"] = np.zeros(self.evidence.shape, bool)
        self._rest = bases.z - (bases.along[:, None] @ bases.q)[:, 0]
        self._left = np.einsum("sv,sv->s", self._rest, self._rest)[:, None]
        self._parts = list(zip(bases.explained.T[:, :, None], bases.ranks.T[:, :, None], strict=True))
        self._free = self._dof - bases.ranks.sum(axis=1, keepdims=True)
        self._along = self._rest @ pool.stacked
        self._overlap = self._projected(pool.stacked)
        taken = np.einsum("swc,swc->sc", self._overlap, self._overlap)
        self._with_single_directions(taken)
        self._with_several_directions(taken)
        self._with_faults()

    def settle(self, here: Bool[np.ndarray, "sets causes"]) -> None:
        """Compute the evidence itself in these places."""
        here = here & self.open
        if not np.any(here):
            return
        for rank in self._pool.by_rank:
            if rank > 1:
                self._settle_blocks(rank, here)
        if len(self._pool.faults):
            self._settle_faults(here)
        self.open &= ~here

    def settled(self) -> Float[np.ndarray, "sets causes"]:
        """The evidence of all."""
        self.settle(self.open)
        return self.evidence

    def _projected(self, columns: Float[np.ndarray, "nu columns"]) -> Float[np.ndarray, "sets width columns"]:
        """Coordinates of columns along the rows of each set."""
        q = self._bases.q
        return (q.reshape(-1, q.shape[2]) @ columns).reshape(*q.shape[:2], columns.shape[1])

    def _with_single_directions(self, taken: Float[np.ndarray, "sets columns"]) -> None:
        causes, columns = self._pool.by_rank.get(1, (np.zeros(0, int), np.zeros((0, 1), int)))
        if not len(causes):
            return
        here = slice(columns[0, 0], columns[-1, 0] + 1)
        left = 1.0 - taken[:, here]
        explained = self._along[:, here] ** 2 / np.maximum(left, COLLINEAR)
        score = log_evidence(self._bases.total[:, None], [*self._parts, (explained, 1)], self._dof, self._known)
        self.evidence[:, causes] = np.where(left > COLLINEAR, score, -np.inf)

    def _with_several_directions(self, taken: Float[np.ndarray, "sets columns"]) -> None:
        several = self._pool.blocks[self._pool.ranks[self._pool.blocks] > 1]
        if not len(several):
            return
        first = self._pool.first_columns[several]
        squares = np.add.reduceat(self._along[:, first[0] :] ** 2, first - first[0], axis=1)
        ranks = np.broadcast_to(self._pool.ranks[several], squares.shape)
        if not self._overlap.shape[1]:
            self.evidence[:, several] = log_evidence(
                self._bases.total[:, None], [(squares, ranks)], self._dof, self._known
            )
            return
        # No eigenvalue of the Gram matrix of what is left of a block is below this; directions below `COLLINEAR` do not count.
        least = 1.0 - np.add.reduceat(taken[:, first[0] :], first - first[0], axis=1)
        explained = np.minimum(squares / np.maximum(least, COLLINEAR), self._left)
        self._bound(several, self._left - explained, self._shortfalls, np.where(least > COLLINEAR, ranks, 1))

    @property
    def _shortfalls(self) -> Float[np.ndarray, "sets 1"]:
        """No less than the sum of the shortfalls of the blocks of each set beside any further block."""
        most = int(self._pool.ranks.max())
        variance = np.ones(1) if self._known else self._left / np.maximum(self._free - most, 1)
        return sum((shortfall(part / variance, rank) for part, rank in self._parts), np.zeros_like(self._left))

    def _bound(
        self,
        causes: Int[np.ndarray, " bound"],
        left: Float[np.ndarray, "sets bound"],
        shortfalls: Float[np.ndarray, "sets 1"],
        ranks: Int[np.ndarray, "*sets bound"],
    ) -> None:
        """What the evidence with some causes of at least these ranks that leave at least so much does not exceed."""
        own = shortfall(np.zeros(ranks.shape), ranks)
        self.evidence[:, causes] = log_evidence_at_most(
            left, self._bases.total[:, None], shortfalls + own, self._free - ranks, self._dof, self._known
        )
        self.open[:, causes] = True

    def _with_faults(self) -> None:
        pool, faults = self._pool, self._pool.faults
        if not len(faults):
            return
        self._offsets = self._projected(pool.offsets)
        beside = pool.offset_squares - np.einsum("swf,swf->sf", self._offsets, self._offsets)
        self._left_by_faults = np.maximum(self._left - 2 * self._rest @ pool.offsets + beside, 0.0)
        if not self._parts:
            self.evidence[:, faults] = log_evidence_of_noise(self._left_by_faults, self._dof, self._known)
            return
        # A fault may be all that a block of the set explains.
        shortfalls = sum(
            (shortfall(np.zeros(part.shape), rank) for part, rank in self._parts), np.zeros_like(self._left)
        )
        self._bound(faults, self._left_by_faults, shortfalls, np.zeros(len(faults), int))

    def _settle_blocks(self, rank: int, here: Bool[np.ndarray, "sets causes"]) -> None:
        causes, columns = self._pool.by_rank[rank]
        sets, number = np.nonzero(here[:, causes])
        if not len(sets):
            return
        columns = columns[number]
        overlap = np.swapaxes(self._overlap, 1, 2)[sets[:, None], columns]
        values, vectors = np.linalg.eigh(np.eye(rank) - overlap @ np.swapaxes(overlap, 1, 2))
        along = (self._along[sets[:, None], columns][:, None] @ vectors)[:, 0]
        free = values > COLLINEAR
        explained = np.sum(np.divide(along**2, values, out=np.zeros_like(values), where=free), axis=1)
        adds = free.sum(axis=1)
        parts = [*((part[sets, 0], ranks[sets, 0]) for part, ranks in self._parts), (explained, adds)]
        score = log_evidence(self._bases.total[sets], parts, self._dof, self._known)
        self.evidence[sets, causes[number]] = np.where(adds > 0, score, -np.inf)

    def _settle_faults(self, here: Bool[np.ndarray, "sets causes"]) -> None:
        faults = self._pool.faults
        sets, number = np.nonzero(here[:, faults])
        squares = (self._bases.along[sets] - self._offsets[sets, :, number]) ** 2
        explained = [squares[:, own].sum(axis=1) for own in self._bases.segments]
        total = self._left_by_faults[sets, number] + sum(explained)
        parts = [(part, ranks[sets, 0]) for part, (_, ranks) in zip(explained, self._parts, strict=True)]
        self.evidence[sets, faults[number]] = log_evidence(total, parts, self._dof, self._known)
