"""Sets of causes: enlarged by each candidate and by each group of effects that is one cause, reduced by each member and each
group, until nothing better is found."""

from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.causes.table import Pool
from tumblecal.diagnosis.priors import NEGLIGIBLE, PROMISING, WIDTH
from tumblecal.diagnosis.sets.cause_sets import MOST, MOST_CAUSES, Members, Ranked, keys_of, rows_of, sets_of
from tumblecal.diagnosis.sets.partial_set import PartialSet, PartialSets, partial_sets, with_each
from tumblecal.diagnosis.sets.positions_off import positions_off
from tumblecal.diagnosis.sets.prior import SetPriors, given_found, log_prior
from tumblecal.full_model.evidence import ROUNDING, log_evidence, log_evidence_of_noise
from tumblecal.full_model.priors import LARGE, SIZE_PRIOR


_MOST_ROUNDS = 16
# Of each batch so many sets are kept in any case: a beam's, by all the ways that lead to each.
_SEATS = 3 * WIDTH
# So many numbers of one array are computed at once.
_NUMBERS_AT_ONCE = 2_000_000


class Search:
    """All sets evaluated for one data set, with their scores (log posteriors, unnormalised).

    - `found`: number of other causes found before. `best`, `leading`: the best score of each size, and its set.
    """

    def __init__(self, pool: Pool, z: Float[np.ndarray, " nu"], known: bool, found: int = 0):
        self.pool: Pool = pool
        self.z: Float[np.ndarray, " nu"] = z
        self.known: bool = known
        self.found: int = found
        null = float(log_evidence_of_noise(np.array(z @ z), pool.dof, known)) + np.log(SIZE_PRIOR[0])
        self.best: list[float] = [null, *[-np.inf] * MOST]
        self.leading: list[Members] = [()] * (MOST + 1)
        self._kept: list[Ranked] = [Ranked(rows_of([()]), np.array([null]))]
        self._expanded: set[Members] = set()
        self._bases: dict[Members, PartialSet] = {}

    def run(self, likely: Members = ()) -> Ranked:
        """Search; `likely`: a set that is evaluated in any case.

        **Returns:** all evaluated sets, best first.
        """
        self.expand([()], groups=True)
        if len(likely) > 1:
            self._score([likely])
        for number in range(_MOST_ROUNDS):
            # Positions that are off hide each other in what they do to the parameters: no way of single steps need lead there.
            if number == 1 and self._best_size > 0 and (off := positions_off(self.pool, self.z)[1]):
                self._score(off)
            singles, groups = self._beginnings()
            new = self.expand([*self._reduced(), *groups], groups=True)
            if not self.expand([*self._beams(), *singles]) and not new:
                break
        return self.ranked()

    def several(self) -> float:
        """Log Bayes factor of all sets of causes against "adequate", at least.

        Single causes are tested before; if neither the best pairs nor two families come near, no larger sets are searched.
        """
        self.expand([(), *self.pool.together.groups], groups=True)
        self.expand(self._beam(1))
        if max(self.best[2:]) > self.best[0] - PROMISING:
            self.run()
        scores = self._evaluated().log_posterior
        odds = np.logaddexp.reduce(scores[scores != self.best[0]], initial=-np.inf) - self.best[0]
        return float(odds - np.log1p(-SIZE_PRIOR[0]) + np.log(SIZE_PRIOR[0]))

    @property
    def top(self) -> float:
        """The best score."""
        return max(self.best)

    @property
    def _best_size(self) -> int:
        """The size of the best set."""
        return int(np.argmax(self.best))

    def ranked(self) -> Ranked:
        """The evaluated sets that are not negligible, best first, given the other causes found before."""
        sets, scores = self._evaluated()
        count = int(np.sum(scores >= self.top - NEGLIGIBLE))
        sets, scores = sets[:count], scores[:count]
        if self.found:
            scores = scores + given_found(SetPriors.of(self.pool, sets).causes, self.found)
        order = (-scores).argsort(kind="stable")
        return Ranked(sets[order], scores[order])

    def posterior(self, members: Members) -> float:
        """Log posterior of a set, unnormalised."""
        return self.posterior_at(members, self.left(members))

    def posterior_at(self, members: Members, left: float) -> float:
        """Log posterior of a set, unnormalised, that leaves another sum of squares than the linear one (an exact fit's)."""
        base = self.base(members)
        total, parts = float(base.z @ base.z), base.explained(base.q.T @ base.z)
        # The whole is what it was: the parts share what is explained as before.
        stretched = (total - left) / max(total - base.left, 1e-300)
        parts = [(part * stretched, rank) for part, rank in parts]
        return float(log_evidence(np.array(total), parts, self.pool.dof, self.known)) + log_prior(self.pool, members)

    def left(self, members: Members) -> float:
        """Sum of squares that a set leaves."""
        return self.base(members).left

    def sigma(self, members: Members) -> float:
        """Standard deviation of the residual of a set, in units of the residual vector."""
        base = self.base(members)
        left = max(base.left, ROUNDING * float(self.z @ self.z))
        return float(np.sqrt(left / max(1, self.pool.dof - base.q.shape[1])))

    def base(self, members: Members) -> PartialSet:
        """Residual and basis of a set, its faults undone first, then its blocks in turn by what they explain."""
        return self.bases([members])[0]

    def bases(self, sets: Sequence[Members]) -> list[PartialSet]:
        """`base` of several sets."""
        new = [members for members in dict.fromkeys(sets) if members not in self._bases]
        if new:
            together = partial_sets(self.pool, self.z, new)
            self._bases.update((members, together.only(row)) for row, members in enumerate(new))
        return [self._bases[members] for members in sets]

    def _beams(self) -> list[Members]:
        """The best sets of each size; of more members than causes where the best set has as many."""
        chosen = self._beam(1)
        for size in range(2, MOST):
            if self.best[size] < max(self.best[size - 1], self.best[0]) - PROMISING:
                break
            if size < MOST_CAUSES or self._best_size >= size:
                chosen += self._beam(size)
        return chosen

    def _beam(self, size: int) -> list[Members]:
        """The best sets of a size; those that are named have seats of their own."""
        sets = self._evaluated().members
        rows = sets[(sets[:, size - 1] >= 0) & (sets[:, size] < 0)]
        named = np.all(self.pool.is_named[rows[:, :size]], axis=1)
        return sets_of(np.concatenate([rows[named][: 2 * WIDTH // 3], rows[: WIDTH // 3]]))

    def _reduced(self) -> list[Members]:
        """The best set of each size without each member, and without each group: all replacements of these are tried then."""
        smaller = list[Members]()
        for size in range(1, MOST + 1):
            if self.best[size] > max(self.top - NEGLIGIBLE, self.best[0]):
                best = self.leading[size]
                smaller += [best[:k] + best[k + 1 :] for k in range(size)]
                groups = (own for own in self.pool.together.groups if {*own} <= {*best})
                smaller += [tuple(k for k in best if k not in own) for own in groups]
        return smaller

    def _beginnings(self) -> tuple[list[Members], list[Members]]:
        """Every effect, and every group, where several causes are or one explains much more than noise: one strong mixture of
        two effects hides both."""
        left = self.left(self.leading[1])
        level = 1.0 if self.known else left / max(1, self.pool.dof - 1)
        large = float(self.z @ self.z) - left > LARGE**2 * level
        several = self._best_size > 1
        singles = [(k,) for k in self.pool.effects.tolist()] if several or large else []
        return singles, self.pool.together.groups if several else []

    def expand(self, sets: Iterable[Members], *, groups: bool = False) -> bool:
        """Score sets with every further candidate, and every group if asked for; whether any of them is new."""
        todo = [members for members in dict.fromkeys(sets) if members not in self._expanded and len(members) < MOST]
        self._expanded.update(todo)
        step = 1 + _NUMBERS_AT_ONCE // (MOST * max(self.pool.size, 1))
        for size in sorted({len(members) for members in todo}):
            own = [members for members in todo if len(members) == size]
            for first in range(0, len(own), step):
                self._expand(own[first : first + step], groups)
        return bool(todo)

    def _expand(self, sets: list[Members], groups: bool) -> None:
        """Score sets of one size, and with each further candidate: the better ones are kept."""
        priors, bases = self._score(sets)
        if not self.pool.size:
            return
        evidence = with_each(self.pool, self.known, bases, groups=groups)
        scores = evidence[:, : self.pool.size] + priors.with_each()
        larger, of_groups = priors.with_groups() if groups else (priors.sets[:0], np.zeros(0))
        of_groups = (evidence[:, self.pool.size :] + of_groups).ravel()
        # Not negligible; and so many in any case, of those that are named too, that the next beam does not shrink where one set
        # is far ahead.
        top = max(self.top, scores.max(initial=-np.inf), of_groups.max(initial=-np.inf))
        named = np.all(self.pool.is_named[priors.sets] | (priors.sets < 0), axis=1)[:, None] & self.pool.is_named
        least = min(top - NEGLIGIBLE, _seat(scores))
        row, added = np.nonzero(scores >= np.where(named, min(least, _seat(scores[named])), least))
        rows, values = priors.sets[row], scores[row, added]
        rows[:, len(sets[0])] = added
        kept = of_groups >= min(least, _seat(of_groups))
        rows, values = np.concatenate([rows, larger[kept]]), np.append(values, of_groups[kept])
        self._add(rows[values > -np.inf], values[values > -np.inf])

    def _score(self, sets: Sequence[Members]) -> tuple[SetPriors, PartialSets]:
        """Score the sets themselves."""
        bases, priors = partial_sets(self.pool, self.z, sets), SetPriors.of(self.pool, rows_of(sets))
        self._add(priors.sets, bases.log_evidence(self.pool.dof, self.known) + priors.own)
        return priors, bases

    def _add(self, rows: Int[np.ndarray, "sets most"], scores: Float[np.ndarray, " sets"]) -> None:
        """Add scored sets, rows of numbers and -1."""
        rows = np.sort(rows.view(np.uint64), axis=1).view(np.int64)
        sizes = (rows >= 0).sum(axis=1)
        for size in set(sizes.tolist()) - {0}:
            own = np.flatnonzero(sizes == size)
            best = own[scores[own].argmax()]
            if scores[best] > self.best[size]:
                self.best[size], self.leading[size] = float(scores[best]), tuple(rows[best, :size].tolist())
        self._kept.append(Ranked(rows[sizes > 0], scores[sizes > 0]))

    def _evaluated(self) -> Ranked:
        """All sets that are kept, each once, the best first."""
        if len(self._kept) > 1:
            sets, scores = (np.concatenate(own) for own in zip(*self._kept, strict=True))
            # A set reached by several ways has scores that differ a little (collinear parts): the best counts.
            keys = keys_of(sets)
            order = np.lexsort((-scores, keys))
            first = order[np.diff(keys[order], prepend=~keys[order[:1]]) != 0]
            first = first[np.argsort(-scores[first], kind="stable")]
            self._kept = [Ranked(sets[first], scores[first])]
        return self._kept[0]


def _seat(scores: Float[np.ndarray, "*sets"]) -> float:
    """The lowest score that has a seat."""
    return float(np.partition(scores, -_SEATS, axis=None)[-_SEATS]) if scores.size > _SEATS else -np.inf
