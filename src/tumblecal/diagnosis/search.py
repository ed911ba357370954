"""Sets of causes: forward from the best, backward and by exchange, until nothing better is found."""

import heapq
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.special import gammaln, logsumexp

from tumblecal.diagnosis.candidates import Pool
from tumblecal.diagnosis.evidence import log_evidence


# Prior probability of the number of simultaneous causes: 0, 1, 2, 3, 4.
SIZE_PRIOR = (0.5, 0.43, 0.055, 0.012, 0.003)
# What is left of a candidate's direction beside those already in the set: below this (squared) it adds nothing.
COLLINEAR = 0.02
WIDTH = 12
# Sets this far (log) below the best are left out of the posterior.
NEGLIGIBLE = 14.0


@dataclass(frozen=True)
class Scored:
    """A set of candidates (indices into the pool) with its unnormalised log posterior."""

    members: tuple[int, ...]
    log_posterior: float


@dataclass(frozen=True)
class _Base:
    """A set to be enlarged: residual after it, orthonormal basis and segments of its blocks."""

    members: tuple[int, ...]
    z: Float[np.ndarray, " nu"]
    q: Float[np.ndarray, "nu rank"]
    segments: tuple[int, ...]


class Search:
    """All sets looked at for one data set, with their scores."""

    def __init__(self, pool: Pool, z: Float[np.ndarray, " nu"], known: bool):
        self.pool, self.z, self.known = pool, z, known
        # Scores by number of members.
        self.scores: list[dict[tuple[int, ...], float]] = [{} for _ in SIZE_PRIOR]
        self._expanded: set[tuple[int, ...]] = set()
        null = log_evidence(np.array(z @ z), [], pool.dof, known)
        self.scores[0][()] = float(null) + np.log(SIZE_PRIOR[0])

    def run(self, most: int = len(SIZE_PRIOR) - 1) -> list[Scored]:
        """Search sets of up to `most` causes.

        **Returns:** all sets looked at, best first.
        """
        self.expand(())
        for size in range(1, most):
            before = self._best(size)
            for members in self._beam(size):
                self.expand(members)
            if self._best(size + 1) < max(before, self._best(0)) - 12.0:
                break
        self._exchange()
        return self.ranked()

    @property
    def top(self) -> float:
        """Log posterior of the best set, unnormalised."""
        return max(map(self._best, range(len(self.scores))))

    def ranked(self) -> list[Scored]:
        """The sets looked at that are not negligible, best first."""
        least = self.top - NEGLIGIBLE
        kept = [Scored(*item) for scores in self.scores for item in scores.items() if item[1] > least]
        return sorted(kept, key=lambda one: -one.log_posterior)

    def left(self, members: tuple[int, ...]) -> float:
        """Sum of squares that a set leaves."""
        base = self.base(members)
        return float(max(base.z @ base.z - np.sum((base.q.T @ base.z) ** 2), 0.0))

    def sigma(self, members: tuple[int, ...]) -> float:
        """Standard deviation of what a set leaves, in units of the residual vector."""
        rank = self.base(members).q.shape[1]
        return float(np.sqrt(self.left(members) / max(1, self.pool.dof - rank)))

    def _best(self, size: int) -> float:
        return max(self.scores[size].values(), default=-np.inf)

    def _beam(self, size: int) -> list[tuple[int, ...]]:
        """The best sets of a size; those without generic terms have places of their own."""
        ranked = heapq.nlargest(200, self.scores[size], key=self.scores[size].__getitem__)
        named = [members for members in ranked if all(self.pool.candidates[k].family != "generic" for k in members)]
        chosen = dict.fromkeys([*named[: 2 * WIDTH // 3], *ranked[: WIDTH // 3]])
        return list(chosen)

    def _exchange(self) -> None:
        """Backward steps and exchanges: every member of the best set is dropped and all replacements tried."""
        for _ in range(4):
            size = max(range(len(self.scores)), key=self._best)
            best = max(self.scores[size], key=self.scores[size].__getitem__)
            smaller = [best[:place] + best[place + 1 :] for place in range(len(best))]
            todo = [members for members in smaller if members not in self._expanded]
            if not todo:
                return
            for members in todo:
                self.expand(members)

    def base(self, members: tuple[int, ...]) -> _Base:
        """Residual and basis of a set, its faults undone first, then its blocks in turn by what they explain."""
        z = self.z.copy()
        for k in members:
            offset = self.pool.candidates[k].offset
            if offset is not None:
                z = z - offset
        blocks = [k for k in members if self.pool.candidates[k].block is not None]
        q, segments = np.zeros((len(z), 0)), []
        for k in blocks:
            block = self.pool.candidates[k].block
            assert block is not None
            rest = block - q @ (q.T @ block)
            left, singular, _ = np.linalg.svd(rest, full_matrices=False)
            new = left[:, singular**2 > COLLINEAR]
            q, segments = np.hstack([q, new]), [*segments, new.shape[1]]
        return _Base(members, z, q, tuple(segments))

    def expand(self, members: tuple[int, ...]) -> None:
        """Score the set with every further candidate."""
        if members in self._expanded or len(members) + 1 >= len(SIZE_PRIOR):
            return
        self._expanded.add(members)
        base = self.base(members)
        self._with_blocks(base)
        if len(self.pool.faults):
            self._with_faults(base)

    def _parts(self, base: _Base, along: np.ndarray) -> list[tuple[np.ndarray, int]]:
        """What each block of the set explains, from the coordinates along `q` (last axis)."""
        ends = np.cumsum((0, *base.segments))
        return [
            (np.sum(along[..., start:stop] ** 2, axis=-1), stop - start)
            for start, stop in pairwise(ends)
            if stop > start
        ]

    def _with_blocks(self, base: _Base) -> None:
        along = base.q.T @ base.z
        rest = base.z - base.q @ along
        total = base.z @ base.z
        overlap = base.q.T @ self.pool.stacked
        projected = self.pool.stacked.T @ rest
        parts = self._parts(base, along)
        for rank, (indices, columns) in self.pool.by_rank.items():
            explained, effective = _explained(projected[columns], overlap[:, columns], rank)
            for own in range(1, rank + 1):
                chosen = effective == own
                if not np.any(chosen):
                    continue
                mine = explained[chosen]
                known_parts = [(np.full_like(mine, part), r) for part, r in parts]
                score = log_evidence(np.full_like(mine, total), [*known_parts, (mine, own)], self.pool.dof, self.known)
                self._note(base.members, indices[chosen], score)

    def _with_faults(self, base: _Base) -> None:
        moved = base.z[:, None] - self.pool.offsets
        total = np.sum(moved**2, axis=0)
        parts = self._parts(base, (base.q.T @ moved).T)
        score = log_evidence(total, parts, self.pool.dof, self.known)
        self._note(base.members, self.pool.faults, score)

    def _note(self, members: tuple[int, ...], indices: np.ndarray, score: np.ndarray) -> None:
        size = len(members) + 1
        prior = np.log(SIZE_PRIOR[size]) + gammaln(size + 1) + sum(self.pool.log_weights[k] for k in members)
        values = score + prior + self.pool.log_weights[indices]
        kept = values > np.max(values, initial=-np.inf) - NEGLIGIBLE
        scores = self.scores[size]
        for k, value in zip(indices[kept].tolist(), values[kept].tolist(), strict=True):
            if k in members:
                continue
            key = tuple(sorted((*members, k)))
            if value > scores.get(key, -np.inf):
                scores[key] = value


def _explained(
    projected: Float[np.ndarray, "candidates rank"], overlap: Float[np.ndarray, "q candidates rank"], rank: int
) -> tuple[np.ndarray, np.ndarray]:
    """Sum of squares that each candidate adds beside `q`, and the rank that it adds."""
    if rank == 1:
        left = 1.0 - np.sum(overlap[:, :, 0] ** 2, axis=0)
        free = left > COLLINEAR
        return np.divide(projected[:, 0] ** 2, left, out=np.zeros(len(left)), where=free), free.astype(int)
    gram = np.eye(rank) - np.einsum("qci,qcj->cij", overlap, overlap)
    values, vectors = np.linalg.eigh(gram)
    free = values > COLLINEAR
    turned = np.einsum("cij,ci->cj", vectors, projected)
    explained = np.divide(turned**2, values, out=np.zeros_like(values), where=free)
    return np.sum(explained, axis=1), np.sum(free, axis=1)


def normalised(scored: list[Scored]) -> Float[np.ndarray, " sets"]:
    """Posterior probabilities of the sets looked at."""
    logs = np.array([one.log_posterior for one in scored])
    return np.exp(logs - logsumexp(logs))
