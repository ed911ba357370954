"""Sets of causes: forward from the best, backward and by exchange, until nothing better is found."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.evidence import log_evidence, log_evidence_of_noise
from tumblecal.diagnosis.partial_set import PartialSet, evidence_of_each, evidence_with_each, partial_set
from tumblecal.diagnosis.pool import Pool
from tumblecal.diagnosis.set_prior import log_prior, log_priors_with_each
from tumblecal.diagnosis.tuning import HOPELESS, NEGLIGIBLE, SIZE_PRIOR, WIDTH


MOST = len(SIZE_PRIOR) - 1
# Larger sets are looked for once the best pair is no farther (log) behind "adequate".
PROMISING = 5.0
_MOST_EXCHANGES = 8


@dataclass(frozen=True)
class Ranked:
    """Sets of candidates with their unnormalised log posteriors, best first; rows of `members` end in -1."""

    members: Int[np.ndarray, "sets most"]
    log_posterior: Float[np.ndarray, " sets"]

    def set_at(self, rank: int) -> tuple[int, ...]:
        """The candidates of the set of this rank."""
        return tuple(k for k in self.members[rank].tolist() if k >= 0)


class Search:
    """All sets looked at for one data set, with their scores."""

    def __init__(self, pool: Pool, z: Float[np.ndarray, " nu"], known: bool):
        self.pool, self.z, self.known = pool, z, known
        null = float(log_evidence_of_noise(np.array(z @ z), pool.dof, known)) + np.log(SIZE_PRIOR[0])
        # For each size the sets kept (rows of sorted indices), and their scores.
        self._sets = [np.zeros((1 if size == 0 else 0, size), np.int64) for size in range(MOST + 1)]
        self._scores = [np.full(1 if size == 0 else 0, null) for size in range(MOST + 1)]
        self._expanded: set[tuple[int, ...]] = set()
        self._bases: dict[tuple[int, ...], PartialSet] = {}

    def run(self, most: int = MOST) -> Ranked:
        """Search sets of up to `most` causes.

        **Returns:** all sets looked at, best first.
        """
        self.expand([()])
        # An effect on all axes is one cause; no way of smaller steps need lead to it.
        families = self.pool.families if most == MOST else []
        if families:
            self._score([self.base(members) for members in families])
        self._forward(most)
        if most > 1 and self._best_size > 1:
            # One strong mixture of two effects hides both: every effect is a beginning then.
            self.expand([(k,) for k in self.pool.effects.tolist()])
            self.expand(families)
            self._forward(most)
        self._exchange(most)
        return self.ranked()

    def several(self) -> float:
        """Log Bayes factor of all sets of causes against "adequate", at least.

        Single causes are tested before; where not even the best pairs come near, no more is looked for.
        """
        self.expand([()])
        self.expand(self._beam(1))
        if self._best(2) > self._best(0) - PROMISING:
            self.run()
        scores = np.concatenate(self._scores[1:])
        odds = np.logaddexp.reduce(scores[np.isfinite(scores)], initial=-np.inf) - self._best(0)
        return float(odds - np.log1p(-SIZE_PRIOR[0]) + np.log(SIZE_PRIOR[0]))

    @property
    def top(self) -> float:
        """Log posterior of the best set, unnormalised."""
        return max(map(self._best, range(MOST + 1)))

    def ranked(self) -> Ranked:
        """The sets looked at that are not negligible, best first."""
        least = self.top - NEGLIGIBLE
        members, scores = [], []
        for size, (sets, values) in enumerate(zip(self._sets, self._scores, strict=True)):
            kept = values > least
            members.append(np.pad(sets[kept], ((0, 0), (0, MOST - size)), constant_values=-1))
            scores.append(values[kept])
        together, values = np.concatenate(members), np.concatenate(scores)
        order = np.argsort(-values, kind="stable")
        return Ranked(together[order], values[order])

    def posterior(self, members: tuple[int, ...]) -> float:
        """Log posterior of a set, unnormalised; -inf for one that was negligible when it was looked at."""
        size = len(members)
        here = np.all(self._sets[size] == np.sort(np.array(members, np.int64)), axis=1)
        return float(np.max(self._scores[size][here], initial=-np.inf))

    def posterior_at(self, members: tuple[int, ...], left: float) -> float:
        """Log posterior of a set, unnormalised, that leaves another sum of squares than the linear one (an exact fit's)."""
        return self._posterior(self.base(members), left)

    def left(self, members: tuple[int, ...]) -> float:
        """Sum of squares that a set leaves."""
        return self.base(members).left

    def sigma(self, members: tuple[int, ...]) -> float:
        """Standard deviation of what a set leaves, in units of the residual vector."""
        base = self.base(members)
        return float(np.sqrt(base.left / max(1, self.pool.dof - base.q.shape[1])))

    def _best(self, size: int) -> float:
        return float(np.max(self._scores[size], initial=-np.inf))

    @property
    def _best_size(self) -> int:
        return max(range(MOST + 1), key=self._best)

    def _forward(self, most: int) -> None:
        """The best sets of each size with one more candidate."""
        for size in range(1, most):
            before = self._best(size)
            self.expand(self._beam(size))
            if self._best(size + 1) < max(before, self._best(0)) - HOPELESS:
                break

    def _beam(self, size: int) -> list[tuple[int, ...]]:
        """The best sets of a size; those that are named have seats of their own."""
        order = np.argsort(-self._scores[size], kind="stable")
        sets = self._sets[size][order]
        named = np.all(self.pool.is_named[sets], axis=1)
        chosen = [*sets[named][: 2 * WIDTH // 3].tolist(), *sets[: WIDTH // 3].tolist()]
        return list(dict.fromkeys(map(tuple, chosen)))

    def _exchange(self, most: int) -> None:
        """Backward steps and exchanges: every member of the best set of each size is dropped, what is left scored, and all
        replacements tried, until nothing new comes up."""
        for _ in range(_MOST_EXCHANGES):
            smaller: set[tuple[int, ...]] = set()
            for size in range(1, most + 1):
                if self._best(size) > max(self.top - NEGLIGIBLE, self._best(0)):
                    best = tuple(self._sets[size][int(np.argmax(self._scores[size]))].tolist())
                    smaller |= {best[:k] + best[k + 1 :] for k in range(size)}
            todo = sorted(smaller - self._expanded)
            if not todo:
                return
            for size in sorted({len(members) for members in todo}):
                self.expand([members for members in todo if len(members) == size])

    def base(self, members: tuple[int, ...]) -> PartialSet:
        """Residual and basis of a set, its faults undone first, then its blocks in turn by what they explain."""
        if members not in self._bases:
            self._bases[members] = partial_set(self.pool, self.z, members)
        return self._bases[members]

    def expand(self, sets: list[tuple[int, ...]]) -> None:
        """Score sets (all of one size) with every further candidate."""
        todo = [members for members in sets if members not in self._expanded and len(members) < MOST]
        if not todo:
            return
        self._expanded.update(todo)
        bases = [self.base(members) for members in todo]
        self._score(bases)
        size = len(todo[0]) + 1
        scores = evidence_with_each(self.pool, self.known, bases)
        members = np.array(todo, np.int64).reshape(len(todo), size - 1)
        for row, own in enumerate(todo):
            scores[row] += log_priors_with_each(self.pool, own)
        np.put_along_axis(scores, members, -np.inf, axis=1)
        self._keep(size, members, scores)

    def _keep(self, size: int, members: np.ndarray, scores: np.ndarray) -> None:
        """Add the better ones of `scores` (sets, candidates) to those kept of a size: those that are not negligible, and so
        many in any case that the next beam does not shrink where one set is far ahead."""
        least = max(self._best(size), float(np.max(scores, initial=-np.inf))) - NEGLIGIBLE
        if scores.size > 3 * WIDTH:
            least = min(least, float(np.partition(scores.ravel(), -3 * WIDTH)[-3 * WIDTH]))
        rows, added = np.nonzero((scores >= least) & np.isfinite(scores))
        self._add(size, np.column_stack([members[rows], added]), scores[rows, added])

    def _score(self, bases: list[PartialSet]) -> None:
        """Score the sets themselves, all of one size."""
        if bases[0].members:
            members = np.array([base.members for base in bases], np.int64)
            prior = np.array([log_prior(self.pool, base.members) for base in bases])
            self._add(members.shape[1], members, evidence_of_each(self.pool, self.known, bases) + prior)

    def _posterior(self, base: PartialSet, left: float | None = None) -> float:
        total, parts = float(base.z @ base.z), base.explained(base.q.T @ base.z)
        if left is not None:
            # The whole is what it was: the parts share what is explained as before.
            stretched = (total - left) / max(total - base.left, 1e-300)
            parts = [(part * stretched, rank) for part, rank in parts]
        evidence = float(log_evidence(np.array(total), parts, self.pool.dof, self.known))
        return evidence + log_prior(self.pool, base.members)

    def _add(self, size: int, sets: np.ndarray, scores: np.ndarray) -> None:
        """Add scored sets to those kept of a size, each set once."""
        sets = np.concatenate([self._sets[size], np.sort(sets, axis=1)])
        values = np.concatenate([self._scores[size], scores])
        # A set reached by several ways has scores that differ a little (collinear parts): the best counts.
        order = np.lexsort((-values, keys_of(sets)))
        keys = keys_of(sets)[order]
        first = order[np.concatenate([[True], keys[1:] != keys[:-1]])] if len(order) else order
        self._sets[size], self._scores[size] = sets[first], values[first]


def keys_of(sets: Int[np.ndarray, "sets size"]) -> np.ndarray:
    """One number for each row of up to four indices (-1: none) below 65535."""
    keys = np.zeros(len(sets), np.uint64)
    for column in range(sets.shape[1]):
        keys = (keys << np.uint64(16)) | (sets[:, column] & 0xFFFF).astype(np.uint64)
    return keys
