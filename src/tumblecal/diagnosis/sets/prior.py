"""Prior of sets of causes: of how many at once, of each kind, and of those that come together."""

from functools import lru_cache
from math import lgamma, log
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.priors import FAULT_WEIGHTS, OF_ORDERS, ON_AXES, SEVERAL_OUTLIERS
from tumblecal.diagnosis.sets.cause_sets import MOST, MOST_CAUSES, Members, rows_of
from tumblecal.effects import AXES
from tumblecal.full_model.priors import EFFECT_WEIGHT, SIZE_PRIOR
from tumblecal.ground.showing import brief


# Prior of a set of this many causes, for the product of their weights.
_LOG_SIZE = np.full(MOST + 2, -np.inf)
_LOG_SIZE[: MOST_CAUSES + 1] = [log(share) + lgamma(size + 1) for size, share in enumerate(SIZE_PRIOR)]
# What one further cause changes of it, for each number of causes.
_ONE_MORE = np.diff(_LOG_SIZE[: MOST_CAUSES + 1])
# Prior of this many outlying positions as one cause, for the product of their weights.
_SEVERAL = (
    log(share) - (outliers - 1) * log(FAULT_WEIGHTS["outlier_position"]) + lgamma(outliers + 1)
    for outliers, share in sorted(SEVERAL_OUTLIERS.items())
)
_LOG_TOGETHER = np.full(MOST + 2, -np.inf)
_LOG_TOGETHER[: 2 + len(SEVERAL_OUTLIERS)] = [0.0, 0.0, *_SEVERAL]
# Which members of a set precede each.
_BEFORE = np.tri(MOST + 1, k=-1, dtype=bool)


def log_prior(pool: Pool, members: Members) -> float:
    """Log prior of one set."""
    return float(SetPriors.of(pool, rows_of([members])).own[0])


def given_found(causes: Int[np.ndarray, " sets"], found: int) -> Float[np.ndarray, " sets"]:
    """Change of the log prior of sets of so many causes, relative to that of none, if `found` other causes (set-up errors,
    faults of the noise) were found before; beyond the largest set each further cause is as rare as its last."""
    last = len(_ONE_MORE) - 1
    steps = (_ONE_MORE[np.minimum(causes + k, last)] - _ONE_MORE[min(k, last)] for k in range(found))
    return sum(steps, np.zeros(len(causes)))


class SetPriors(NamedTuple):
    """Priors of sets, as rows of indices into a pool.

    - `there`: which entries of the rows are causes. `outliers`: number of outlying positions.
    - `causes`: how many a set counts for: axes of a family are one cause, and so are a polynomial's lowest powers, and
      outlying positions. `log_weight`: of the causes.
    """

    __repr__ = brief

    pool: Pool
    sets: Int[np.ndarray, "sets most"]
    there: Bool[np.ndarray, "sets most"]
    outliers: Int[np.ndarray, " sets"]
    causes: Int[np.ndarray, " sets"]
    log_weight: Float[np.ndarray, " sets"]

    @classmethod
    def of(cls, pool: Pool, sets: Int[np.ndarray, "sets most"]) -> "SetPriors":
        """The priors of some sets, as rows of indices into the pool."""
        there = sets >= 0
        if not there.any():
            # Only the empty set: a pool may contain no cause.
            none, count = np.zeros(len(sets), int), np.zeros(len(sets))
            return cls(pool, sets, there, none, none, count)
        outliers = (pool.is_outlier[sets] & there).sum(axis=1)
        causes, log_weight = there.sum(axis=1), np.where(there, pool.log_weights[sets], 0.0).sum(axis=1)
        rows = np.flatnonzero((there & (pool.together.partners[sets, 0] >= 0)).sum(axis=1) > 1)
        if len(rows):
            # As narrow as the largest of them: -1 is sorted last, as the largest number.
            several = np.sort(sets[rows].view(np.uint64), axis=1).view(np.int64)[:, : int(causes[rows].max())]
            causes[rows], log_weight[rows] = _together(pool, several)
            # A member is counted in one way only: with the other axes, or with the other powers.
            of_both = (pool.together.family[several] >= 0) & (pool.together.polynomial[several] >= 0)
            both = np.flatnonzero(np.any((several >= 0) & of_both, axis=1))
            if len(both):
                further = _together(pool, several[both], powers_first=True)
                better = _LOG_SIZE[further[0]] + further[1] > (_LOG_SIZE[causes] + log_weight)[rows[both]]
                causes[rows[both[better]]], log_weight[rows[both[better]]] = further[0][better], further[1][better]
        causes, log_weight = causes - np.maximum(outliers - 1, 0), log_weight + _LOG_TOGETHER[outliers]
        return cls(pool, sets, there, outliers, causes, log_weight)

    @property
    def own(self) -> Float[np.ndarray, " sets"]:
        """Log prior of each set."""
        return _LOG_SIZE[self.causes] + self.log_weight

    def beside(self, log_weights: Float[np.ndarray, " further"]) -> Float[np.ndarray, "sets further"]:
        """Log prior of each set with a further cause of each of these log weights that comes together with none of the set."""
        return (_LOG_SIZE[self.causes + 1] + self.log_weight)[:, None] + log_weights

    def with_groups(self) -> tuple[Int[np.ndarray, "larger most"], Float[np.ndarray, "sets groups"]]:
        """Each set with each group of effects that are one cause, as rows, and their log priors; -inf for one that is too
        large."""
        groups, count = self.pool.together.groups, len(self.sets)
        both = np.hstack([np.repeat(self.sets, len(groups), axis=0), np.tile(rows_of(groups, len(AXES)), (count, 1))])
        # -1 as the largest number is last.
        both = np.sort(both.view(np.uint64), axis=1)
        both[:, 1:][both[:, 1:] == both[:, :-1]] = np.uint64(2**64 - 1)
        both = np.sort(both, axis=1).view(np.int64)
        fits = both[:, MOST] < 0
        priors = np.where(fits, SetPriors.of(self.pool, both[:, :MOST]).own, -np.inf)
        return both[:, :MOST], priors.reshape(count, len(groups))

    def with_each(self) -> Float[np.ndarray, "sets causes"]:
        """Log prior of each set with each further candidate; -inf for its own, and for an effect of the set from another
        start."""
        pool, priors, outliers = self.pool, self.beside(self.pool.log_weights), self.outliers
        if outliers.any():
            # One more outlying position is no further cause.
            rows, further = np.nonzero((outliers > 0)[:, None] & pool.is_outlier)
            several = self.own + _LOG_TOGETHER[outliers + 1] - _LOG_TOGETHER[outliers]
            priors[rows, further] = several[rows] + pool.log_weights[further]
        further = np.where(self.there[:, :, None], pool.together.partners[self.sets], -1).reshape(len(self.sets), -1)
        rows, column = (further >= 0).nonzero()
        if len(rows):
            further = further[rows, column]
            new = (self.sets[rows] != further[:, None]).all(axis=1)
            rows, further = rows[new], further[new]
            priors[rows, further] = SetPriors.of(pool, np.column_stack([self.sets[rows], further])).own
        starts = np.where(self.there, pool.starts[self.sets], -1)
        for row, member in zip(*(starts >= 0).nonzero(), strict=True):
            others = np.flatnonzero(pool.starts == starts[row, member])
            priors[row, others] = -np.inf
        priors[self.there.nonzero()[0], self.sets[self.there]] = -np.inf
        return priors


def _together(
    pool: Pool, sets: Int[np.ndarray, "sets most"], *, powers_first: bool = False
) -> tuple[Int[np.ndarray, " sets"], Float[np.ndarray, " sets"]]:
    """How many causes sets count for and the log weight of these, each member in the first group that it shares with others."""
    there = sets >= 0
    each, alone, follows = np.where(there, pool.log_weights[sets], 0.0), there, np.zeros(sets.shape, bool)
    before, together = _BEFORE[: sets.shape[1], : sets.shape[1]], pool.together
    on_axes, of_orders = _log_on_axes(len(together.axes)), _log_of_orders(tuple(map(len, together.polynomials)))
    ways = [(together.family, on_axes, False), (together.polynomial, of_orders, True)]
    for groups, log_weights, lowest in reversed(ways) if powers_first else ways:
        own = np.where(alone, groups[sets], -1)
        same = (own[:, :, None] == own[:, None, :]) & (own >= 0)[:, :, None]
        count = same.sum(axis=2)
        one = (count > 1) & (count < len(log_weights))
        if lowest:
            # Of a polynomial no power below the highest may be missing.
            one &= np.where(same, together.lower[sets][:, None, :], 0).max(axis=2) == count - 1
        later = one & np.any(same & before, axis=2)
        # The first stands for all.
        each = np.where(later, 0.0, np.where(one, log_weights[np.where(one, count, 0)], each))
        alone, follows = alone & ~one, follows | later
    return there.sum(axis=1) - follows.sum(axis=1), each.sum(axis=1)


@lru_cache
def _log_on_axes(families: int) -> Float[np.ndarray, " axes"]:
    """Logarithm of the weight of a family of so many that acts on so many axes; 0 where that is no more than one."""
    choices = {2: 3 * families, 3: families}
    several = (log(ON_AXES[axes] * EFFECT_WEIGHT / max(choices[axes], 1)) for axes in (2, 3))
    return np.array([0.0, 0.0, *several])


@lru_cache
def _log_of_orders(sizes: tuple[int, ...]) -> Float[np.ndarray, " orders"]:
    """Logarithm of the weight of so many of the lowest powers of a polynomial; 0 where that is no more than one.

    **Arguments:**

    - `sizes`: how many powers each polynomial of a pool has.
    """
    several = (
        log(share * EFFECT_WEIGHT / max(sum(size >= orders for size in sizes), 1)) for orders, share in OF_ORDERS
    )
    return np.array([0.0, 0.0, *several])
