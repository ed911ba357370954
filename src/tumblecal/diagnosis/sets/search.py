"""Sets of causes: forward from the best, backward and by exchange, until nothing better is found."""

from collections.abc import Sequence
from itertools import permutations

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.priors import NEGLIGIBLE, OF_ORDERS, PROMISING, WIDTH
from tumblecal.diagnosis.sets.cause_sets import MOST, MOST_CAUSES, Members, Ranked, rows_of
from tumblecal.diagnosis.sets.enlarged import Enlarged
from tumblecal.diagnosis.sets.evaluated import Evaluated
from tumblecal.diagnosis.sets.partial_set import PartialSet, PartialSets, least_left, partial_sets
from tumblecal.diagnosis.sets.positions_off import off_together
from tumblecal.diagnosis.sets.prior import SetPriors, given_found, log_prior
from tumblecal.effects import AXES
from tumblecal.full_model.evidence import (
    ROUNDING,
    highest_shortfall,
    log_evidence,
    log_evidence_at_most,
    log_evidence_of_noise,
)
from tumblecal.full_model.priors import LARGE, SIZE_PRIOR


_MOST_EXCHANGES = 8
# Of each batch so many sets are kept in any case: a beam's, by all the ways that lead to each.
_SEATS = 3 * WIDTH
# So many numbers of one array are computed at once.
_NUMBERS_AT_ONCE = 2_000_000


class Search:
    """All sets evaluated for one data set, with their scores; `found`: number of other causes found before."""

    def __init__(self, pool: Pool, z: Float[np.ndarray, " nu"], known: bool, found: int = 0):
        self.pool: Pool = pool
        self.z: Float[np.ndarray, " nu"] = z
        self.known: bool = known
        self.found: int = found
        null = float(log_evidence_of_noise(np.array(z @ z), pool.dof, known)) + np.log(SIZE_PRIOR[0])
        self._evaluated = Evaluated(null)
        self._expanded: set[Members] = set()
        self._exchanged: set[Members] = set()
        self._bases: dict[Members, PartialSet] = {}

    def run(self, most: int = MOST, likely: Members = ()) -> Ranked:
        """Search sets of up to `most` causes; `likely`: one that is evaluated in any case.

        **Returns:** all evaluated sets, best first.
        """
        self.expand([()])
        families, polynomials = (self._families, self._polynomials) if most == MOST else ([], [])
        if looked_at := [*([likely] if len(likely) > 1 else []), *families, *polynomials]:
            self._score(partial_sets(self.pool, self.z, looked_at))
        self._forward(most)
        # Positions that are off hide each other in what they do to the parameters: no way of single steps need lead to them.
        if most == MOST and self._evaluated.best_size > 0 and (off := off_together(self.pool, self.z)):
            self._score(partial_sets(self.pool, self.z, off))
        if most > 1 and (self._evaluated.best_size > 1 or self._large):
            # One strong mixture of two effects hides both: every effect is a beginning then.
            self.expand([(k,) for k in self.pool.effects.tolist()])
        if most > 1 and self._evaluated.best_size > 1:
            self.expand([*families, *polynomials])
            self._expand_families(families)
            self._forward(most)
        self._exchange(most)
        return self.ranked()

    def several(self) -> float:
        """Log Bayes factor of all sets of causes against "adequate", at least.

        Single causes are tested before; if neither the best pairs nor two families come near, no larger sets are searched.
        """
        self.expand([()])
        self.expand(self._beam(1))
        promising = self._evaluated.best[0] - PROMISING
        self._expand_families(self._families, promising)
        if max(self._evaluated.best[2:]) > promising:
            self.run()
        scores = np.concatenate([self._evaluated.of_size(size)[1] for size in range(1, MOST + 1)])
        odds = np.logaddexp.reduce(scores[np.isfinite(scores)], initial=-np.inf) - self._evaluated.best[0]
        return float(odds - np.log1p(-SIZE_PRIOR[0]) + np.log(SIZE_PRIOR[0]))

    @property
    def top(self) -> float:
        """Log posterior of the best set, unnormalised."""
        return self._evaluated.top

    def ranked(self) -> Ranked:
        """The evaluated sets that are not negligible, best first, given the other causes found before."""
        sets, scores = self._evaluated.no_less_than(self.top - NEGLIGIBLE)
        if self.found:
            scores = scores + given_found(SetPriors.of(self.pool, sets).causes, self.found)
        order = (-scores).argsort(kind="stable")
        return Ranked(sets[order], scores[order])

    def posterior(self, members: Members) -> float:
        """Log posterior of a set, unnormalised."""
        score = self._evaluated.score_of(members)
        return self.posterior_at(members, self.left(members)) if score is None else score

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

    @property
    def _families(self) -> list[Members]:
        """The effects on all axes: each is one cause, and no way of smaller steps need lead to it."""
        return [tuple(axes) for axes in np.sort(self.pool.axes, axis=1).tolist()]

    @property
    def _polynomials(self) -> list[Members]:
        """The lowest powers of each variable on each output: each is one cause, whatever the variable's reference is."""
        listed = (
            own[:orders] for own in self.pool.together.polynomials for orders, _ in OF_ORDERS if orders <= len(own)
        )
        return [tuple(sorted(own)) for own in listed]

    @property
    def _large(self) -> bool:
        """Whether the best single cause explains much more than noise: what two effects make may look like it."""
        left = self.left(self._evaluated.leading[1])
        level = 1.0 if self.known else left / max(1, self.pool.dof - 1)
        return float(self.z @ self.z) - left > LARGE**2 * level

    @property
    def _best_named(self) -> float:
        """The best score of a single cause that has a name: one without, of many coefficients, is better than most sets."""
        sets, scores = self._evaluated.of_size(1)
        return float(scores[self.pool.is_named[sets[:, 0]]].max(initial=-np.inf))

    def _forward(self, most: int) -> None:
        """The best sets of each size with one more candidate; of more members than causes where the best set has as many."""
        for size in range(1, most):
            if size >= MOST_CAUSES and self._evaluated.best_size < size:
                break
            before = self._evaluated.best[size]
            self.expand(self._beam(size))
            if self._evaluated.best[size + 1] < max(before, self._evaluated.best[0]) - PROMISING:
                break

    def _beam(self, size: int) -> list[Members]:
        """The best sets of a size; those that are named have seats of their own."""
        sets, scores = self._evaluated.of_size(size)
        sets = sets[(-scores).argsort(kind="stable")]
        named = np.all(self.pool.is_named[sets], axis=1)
        chosen = [*sets[named][: 2 * WIDTH // 3].tolist(), *sets[: WIDTH // 3].tolist()]
        return list(dict.fromkeys(map(tuple, chosen)))

    def _exchange(self, most: int) -> None:
        """Backward steps and exchanges: every member of the best set of each size is dropped, the rest scored, and all
        replacements tried, until no new set is found."""
        for _ in range(_MOST_EXCHANGES):
            smaller: set[Members] = set()
            for size in range(1, most + 1):
                if self._evaluated.best[size] > max(self.top - NEGLIGIBLE, self._evaluated.best[0]):
                    best = self._evaluated.leading[size]
                    smaller |= {best[:k] + best[k + 1 :] for k in range(size)}
            if most == MOST:
                self._exchange_for_families(self._evaluated.leading[self._evaluated.best_size])
            todo = sorted(smaller - self._expanded)
            if not todo:
                return
            self.expand(todo)

    def _exchange_for_families(self, best: Members) -> None:
        """The best set with an effect on all axes, or a polynomial, in place of each member with a time constant, or without a
        name: a long warm-up is a drift, many coefficients may be one on every axis, and no exchange of single effects leads
        there. Nor does one lead from an order of the temperature on all axes to another."""
        flexible = [k for k in best if self.pool.slots[k].shape or not self.pool.is_named[k]]
        several = [*self._families, *self._polynomials]
        sets = {tuple(sorted({*best} - {k} | {*own})) for k in flexible for own in several}
        slots = self.pool.slots
        parameters = {own: [slots[k].parameter_over_temperature for k in own] for own in self._families}
        for own, other in permutations(self._families, 2):
            if {*own} <= {*best} and all(parameters[own]) and parameters[own] == parameters[other]:
                sets.add(tuple(sorted({*best} - {*own} | {*other})))
        sets = {members for members in sets if len(best) <= len(members) <= MOST} - self._exchanged
        if sets:
            self._exchanged |= sets
            self._score(partial_sets(self.pool, self.z, sorted(sets)))

    def expand(self, sets: Sequence[Members]) -> None:
        """Score sets with every further candidate."""
        todo = [members for members in sets if members not in self._expanded and len(members) < MOST]
        self._expanded.update(todo)
        if not self.pool.size:
            # These positions can show no cause.
            self._score(partial_sets(self.pool, self.z, todo))
            return
        step = 1 + _NUMBERS_AT_ONCE // (MOST * self.pool.size)
        for first in range(0, len(todo), step):
            bases = partial_sets(self.pool, self.z, todo[first : first + step])
            self._keep(self._score(bases), Enlarged(self.pool, self.known, bases))

    def _keep(self, bases: SetPriors, enlarged: Enlarged) -> None:
        """Add the better ones of sets with one candidate more to those kept: those that are not negligible, and so many in any
        case that the next beam does not shrink where one set is far ahead."""
        sets, there, named = bases.sets, bases.there, self.pool.is_named
        sizes, priors = 1 + there.sum(axis=1), bases.with_each()
        priors[there.nonzero()[0], sets[there]] = -np.inf
        all_named = np.all(named[sets] | ~there, axis=1)[:, None] & named
        beside = max(self._evaluated.best[size] for size in set(sizes.tolist()))
        scores = enlarged.evidence + priors
        least = self._least(np.where(enlarged.open, -np.inf, scores), all_named, beside)
        enlarged.settle(scores >= least)
        scores = np.where(enlarged.open, -np.inf, enlarged.evidence + priors)
        rows, added = ((scores >= least) & (scores > -np.inf)).nonzero()
        scores = scores[rows, added]
        kept = scores >= self._least(scores, all_named[rows, added], beside)
        together = sets[rows[kept]]
        together[np.arange(len(together)), sizes[rows[kept]] - 1] = added[kept]
        self._evaluated.add(together, scores[kept])

    def _least(
        self, scores: Float[np.ndarray, "*sets"], named: Bool[np.ndarray, "*sets"], beside: float
    ) -> Float[np.ndarray, "*sets"]:
        """The score that each set must have to be kept, by those that are known; `beside`: the best of its size before."""
        best, seat = float(scores.max(initial=-np.inf)), _seat(scores)
        # Named sets have the same quota among themselves, for those not negligible relative to others of their size.
        own = max(_seat(scores[named]), min(seat, max(best, beside) - NEGLIGIBLE))
        return np.minimum(max(self.top, best) - NEGLIGIBLE, np.where(named, own, seat))

    def _expand_families(self, families: list[Members], least: float = -np.inf) -> None:
        """The best sets of two families, of three where two beat any single named cause, and each with one candidate more.

        What drifts, or follows the temperature, seldom does so in one way and on one axis; by smaller steps other causes
        seem to explain it better. `least`: a score that the best of two must have.
        """
        before = families
        for size in range(2 * len(AXES), MOST, len(AXES)):
            sets = {tuple(sorted(own + other)) for own in before for other in families if not set(own) & set(other)}
            hopeful = self._may_score(sorted(sets), least)
            if not hopeful:
                return
            self._score(partial_sets(self.pool, self.z, hopeful))
            if self._evaluated.best[size] < least:
                return
            before = self._beam(size)
            self.expand(before)
            if self._evaluated.best[size] < self._best_named:
                return

    def _may_score(self, sets: list[Members], least: float) -> list[Members]:
        """Sets of effects, of those given, whose score may be as high as `least`."""
        if least == -np.inf or not sets:
            return sets
        rows, total = rows_of(sets), float(self.z @ self.z)
        left, ranks = least_left(self.pool, self.z, rows)
        # Directions that do not count take nothing from the noise.
        free, shortfalls = np.full(len(sets), self.pool.dof), np.where(ranks > 0, highest_shortfall(1), 0.0).sum(axis=1)
        most = log_evidence_at_most(left, np.array(total), shortfalls, free, self.pool.dof, self.known)
        may = most + SetPriors.of(self.pool, rows).own >= least
        return [members for members, here in zip(sets, may.tolist(), strict=True) if here]

    def _score(self, bases: PartialSets) -> SetPriors:
        """Score the sets themselves: their priors."""
        priors = SetPriors.of(self.pool, rows_of(bases.members))
        self._evaluated.add(priors.sets, bases.log_evidence(self.pool.dof, self.known) + priors.own)
        return priors


def _seat(scores: Float[np.ndarray, "*sets"]) -> float:
    """The lowest score that has a seat."""
    return float(np.partition(scores, -_SEATS, axis=None)[-_SEATS]) if scores.size > _SEATS else -np.inf
