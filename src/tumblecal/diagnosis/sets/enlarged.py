"""Sets of causes with one cause more: the evidence of each, or an upper bound.

The residual space is projected off a set's blocks. A further block of one direction then explains its squared coordinate
divided by the remainder of the direction. A block of several directions needs a Gram matrix for each set, and a fault changes
the contribution of every block of the set. These are computed only for the few that can matter according to a bound.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.priors import COLLINEAR
from tumblecal.diagnosis.sets.partial_set import PartialSets
from tumblecal.full_model.evidence import (
    highest_shortfall,
    log_evidence,
    log_evidence_at_most,
    log_evidence_of_noise,
    shortfall,
)


class Enlarged:
    """Sets with every cause of a pool.

    - `evidence` (sets, causes): log evidence of each set with each cause; -inf where that adds nothing.
    - `open` (sets, causes): entries that are upper bounds until `settle` computes the evidence.
    """

    def __init__(self, pool: Pool, known: bool, bases: PartialSets):
        self._pool, self._known, self._bases, self._dof = pool, known, bases, pool.dof - bases.aside
        self.evidence: Float[np.ndarray, "sets causes"] = np.full((len(bases.z), len(pool.causes)), -np.inf)
        self.open: Bool[np.ndarray, "sets causes"] = np.zeros(self.evidence.shape, bool)
        self._rest = bases.z - (bases.along[:, None] @ bases.q)[:, 0]
        self._left = np.vecdot(self._rest, self._rest)[:, None]
        self._parts = list(zip(bases.explained.T[:, :, None], bases.ranks.T[:, :, None], strict=True))
        self._free = self._dof - bases.ranks.sum(axis=1, keepdims=True)
        self._along = self._rest @ pool.stacked
        self._overlap = self._projected(pool.stacked)
        taken = (self._overlap**2).sum(axis=1)
        self._with_single_directions(taken)
        self._with_several_directions(taken)
        self._with_faults()

    def settle(self, here: Bool[np.ndarray, "sets causes"]) -> None:
        """Compute the evidence itself in these places."""
        here = here & self.open
        if not here.any():
            return
        self._settle_blocks(here)
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
        # In `stacked` those of the lowest rank come first.
        blocks, ranks = self._pool.blocks, self._pool.ranks[self._pool.blocks]
        causes = blocks[ranks == 1]
        if not len(causes):
            return
        first = self._pool.first_columns[causes[0]]
        here = slice(first, first + len(causes))
        left = 1.0 - taken[:, here]
        explained = self._along[:, here] ** 2 / np.maximum(left, COLLINEAR)
        score = log_evidence(self._bases.total[:, None], [*self._parts, (explained, 1)], self._dof, self._known)
        self.evidence[:, causes] = np.where(left > COLLINEAR, score, -np.inf)

    def _with_several_directions(self, taken: Float[np.ndarray, "sets columns"]) -> None:
        pool = self._pool
        self._several = several = pool.blocks[pool.ranks[pool.blocks] > 1]
        if not len(several):
            return
        first = pool.first_columns[several]
        here, starts = slice(first[0], None), first - first[0]
        along, ranks = self._along[:, here], pool.ranks[several]
        self._squares = np.add.reduceat(along**2, starts, axis=1)
        if not self._overlap.shape[1]:
            parts = [(self._squares, np.broadcast_to(ranks, self._squares.shape))]
            self.evidence[:, several] = log_evidence(self._bases.total[:, None], parts, self._dof, self._known)
            return
        # With its overlap O a block explains p'(1 - O'O)^-1 p, which is p'p and, of all along Op, (Op)'(1 - OO')^-1 Op.
        self._toward = np.add.reduceat(self._overlap[:, :, here] * along[:, None], starts, axis=2)
        # No eigenvalue of 1 - OO' is below this; directions below `COLLINEAR` do not count.
        least = 1.0 - np.add.reduceat(taken[:, here], starts, axis=1)
        beyond = (self._toward**2).sum(axis=1) / np.maximum(least, COLLINEAR)
        left = self._left - np.minimum(self._squares + beyond, self._left)
        self._bound(several, left, self._shortfalls, np.where(least > COLLINEAR, ranks, 1))

    @property
    def _shortfalls(self) -> Float[np.ndarray, "sets 1"]:
        """Upper bound of the sum of the shortfalls of the blocks of each set, given any further block."""
        most = int(self._pool.ranks.max())
        variance = 1.0 if self._known else self._left / np.maximum(self._free - most, 1)
        return shortfall(self._bases.explained / variance, self._bases.ranks).sum(axis=1, keepdims=True)

    def _bound(
        self,
        causes: Int[np.ndarray, " bound"],
        left: Float[np.ndarray, "sets bound"],
        shortfalls: Float[np.ndarray, "sets 1"],
        ranks: Int[np.ndarray, "*sets bound"],
    ) -> None:
        """What the evidence with some causes of at least these ranks that leave at least so much does not exceed."""
        shortfalls = shortfalls + highest_shortfall(ranks)
        self.evidence[:, causes] = log_evidence_at_most(
            left, self._bases.total[:, None], shortfalls, self._free - ranks, self._dof, self._known
        )
        self.open[:, causes] = True

    def _with_faults(self) -> None:
        pool, faults = self._pool, self._pool.faults
        if not len(faults):
            return
        self._offsets = self._projected(pool.offsets)
        beside = pool.offset_squares - (self._offsets**2).sum(axis=1)
        self._left_by_faults = np.maximum(self._left - 2 * self._rest @ pool.offsets + beside, 0.0)
        if not self._parts:
            self.evidence[:, faults] = log_evidence_of_noise(self._left_by_faults, self._dof, self._known)
            return
        # A fault may be all that a block of the set explains.
        shortfalls = highest_shortfall(self._bases.ranks).sum(axis=1, keepdims=True)
        self._bound(faults, self._left_by_faults, shortfalls, np.zeros(len(faults), int))

    def _settle_blocks(self, here: Bool[np.ndarray, "sets causes"]) -> None:
        # Blocks of one rank together: the eigenvalue problem has the dimension of the block, or of the set if that is smaller.
        ranks = self._pool.ranks[self._several]
        for rank in np.unique(ranks).tolist():
            own = np.flatnonzero(ranks == rank)
            sets, number = here[:, self._several[own]].nonzero()
            if len(sets):
                self._settle_blocks_of(rank, sets, own[number])

    def _settle_blocks_of(self, rank: int, sets: Int[np.ndarray, " open"], number: Int[np.ndarray, " open"]) -> None:
        """Settle sets with blocks of one rank, by their number among those of several directions."""
        causes = self._several[number]
        columns = self._pool.first_columns[causes][:, None] + np.arange(rank)
        overlap = self._overlap[sets[:, None], :, columns]
        of_block = rank < overlap.shape[2]
        taken, turn = np.linalg.eigh(overlap @ overlap.mT if of_block else overlap.mT @ overlap)
        free = 1.0 - taken > COLLINEAR
        if of_block:
            along = (self._along[sets[:, None], columns][:, None] @ turn)[:, 0] ** 2
            explained = np.vecdot(along, np.where(free, 1.0 / np.maximum(1.0 - taken, COLLINEAR), 0.0))
        else:
            toward = (self._toward[sets, :, number][:, None] @ turn)[:, 0] ** 2
            # A direction that does not count takes with it what it has of p'p.
            weight = np.where(free, 1.0 / np.maximum(1.0 - taken, COLLINEAR), -1.0 / np.maximum(taken, COLLINEAR))
            explained = self._squares[sets, number] + np.vecdot(toward, weight)
        adds = rank - (~free).sum(axis=1)
        parts = [*((part[sets, 0], ranks[sets, 0]) for part, ranks in self._parts), (explained, adds)]
        score = log_evidence(self._bases.total[sets], parts, self._dof, self._known)
        self.evidence[sets, causes] = np.where(adds > 0, score, -np.inf)

    def _settle_faults(self, here: Bool[np.ndarray, "sets causes"]) -> None:
        faults = self._pool.faults
        sets, number = here[:, faults].nonzero()
        if not len(sets):
            return
        squares = (self._bases.along[sets] - self._offsets[sets, :, number]) ** 2
        explained = [squares[:, own].sum(axis=1) for own in self._bases.segments]
        total = self._left_by_faults[sets, number] + sum(explained)
        parts = [(part, ranks[sets, 0]) for part, (_, ranks) in zip(explained, self._parts, strict=True)]
        self.evidence[sets, faults[number]] = log_evidence(total, parts, self._dof, self._known)
