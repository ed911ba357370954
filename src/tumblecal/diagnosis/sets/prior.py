"""Prior of sets of causes: of how many at once, of each kind, and of those that come together."""

from functools import lru_cache
from math import lgamma, log
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.sets.cause_sets import MOST, MOST_CAUSES, Members, rows_of
from tumblecal.diagnosis.tuning import EFFECT_WEIGHT, FAULT_WEIGHTS, ON_AXES, SEVERAL_OUTLIERS, SIZE_PRIOR
from tumblecal.effects import AXES
from tumblecal.ground.showing import brief


# Prior of a set of this many causes, for the product of their weights.
_LOG_SIZE = np.full(MOST + 2, -np.inf)
_LOG_SIZE[: MOST_CAUSES + 1] = [log(share) + lgamma(size + 1) for size, share in enumerate(SIZE_PRIOR)]
# Prior of this many outlying positions as one cause, for the product of their weights.
_SEVERAL = (
    log(share) - (outliers - 1) * log(FAULT_WEIGHTS["outlier_position"]) + lgamma(outliers + 1)
    for outliers, share in sorted(SEVERAL_OUTLIERS.items())
)
_LOG_TOGETHER = np.full(MOST + 2, -np.inf)
_LOG_TOGETHER[: 2 + len(SEVERAL_OUTLIERS)] = [0.0, 0.0, *_SEVERAL]
# Which members of a set stand before each.
_BEFORE = np.tri(MOST + 1, k=-1, dtype=bool)


def log_prior(pool: Pool, members: Members) -> float:
    """Log prior of one set."""
    return float(SetPriors.of(pool, rows_of([members])).own[0])


class SetPriors(NamedTuple):
    """Priors of sets, as rows of indices into a pool.

    - `there`: which entries of the rows are causes; `family`: of which family of axes each is, -1: of none.
    - `outliers`: number of outlying positions. `causes`: how many a set counts for: axes of a family are one cause, and so are
      outlying positions. `log_weight`: of the causes.
    """

    __repr__ = brief

    pool: Pool
    sets: Int[np.ndarray, "sets most"]
    there: Bool[np.ndarray, "sets most"]
    family: Int[np.ndarray, "sets most"]
    outliers: Int[np.ndarray, " sets"]
    causes: Int[np.ndarray, " sets"]
    log_weight: Float[np.ndarray, " sets"]

    @classmethod
    def of(cls, pool: Pool, sets: Int[np.ndarray, "sets most"]) -> "SetPriors":
        """Those of some sets."""
        there = sets >= 0
        if not there.any():
            # Of nothing alone; a pool may hold no cause at all.
            none, count = np.zeros(len(sets), int), np.zeros(len(sets))
            return cls(pool, sets, there, np.full(sets.shape, -1), none, none, count)
        each, family = np.where(there, pool.log_weights[sets], 0.0), np.where(there, pool.family[sets], -1)
        outliers = (pool.is_outlier[sets] & there).sum(axis=1)
        causes = there.sum(axis=1) - np.maximum(outliers - 1, 0)
        if np.count_nonzero(family >= 0) > 1:
            same = (family[:, :, None] == family[:, None, :]) & (family >= 0)[:, :, None]
            axes = same.sum(axis=2)
            # Of the axes of a family the first stands for all.
            follows = np.any(same & _BEFORE[: sets.shape[1], : sets.shape[1]], axis=2)
            each = np.where(axes > 1, _log_on_axes(len(pool.axes))[axes], each)
            each, causes = np.where(follows, 0.0, each), causes - follows.sum(axis=1)
        return cls(pool, sets, there, family, outliers, causes, each.sum(axis=1) + _LOG_TOGETHER[outliers])

    @property
    def own(self) -> Float[np.ndarray, " sets"]:
        """Log prior of each set."""
        return _LOG_SIZE[self.causes] + self.log_weight

    def beside(self, log_weights: Float[np.ndarray, " further"]) -> Float[np.ndarray, "sets further"]:
        """Log prior of each set with a further cause of each of these log weights that comes together with none of the set."""
        return (_LOG_SIZE[self.causes + 1] + self.log_weight)[:, None] + log_weights

    def with_each(self) -> Float[np.ndarray, "sets causes"]:
        """Log prior of each set with each further candidate; -inf for an effect of the set from another start."""
        pool, priors, outliers = self.pool, self.beside(self.pool.log_weights), self.outliers
        if outliers.any():
            # One more outlying position is no further cause.
            rows, further = np.nonzero((outliers > 0)[:, None] & pool.is_outlier)
            several = self.own + _LOG_TOGETHER[outliers + 1] - _LOG_TOGETHER[outliers]
            priors[rows, further] = several[rows] + pool.log_weights[further]
        rows, member = (self.family >= 0).nonzero()
        if len(rows):
            further = pool.axes[self.family[rows, member]].ravel()
            rows = np.repeat(rows, len(AXES))
            new = (self.sets[rows] != further[:, None]).all(axis=1)
            rows, further = rows[new], further[new]
            priors[rows, further] = SetPriors.of(pool, np.column_stack([self.sets[rows], further])).own
        starts = np.where(self.there, pool.starts[self.sets], -1)
        for row, member in zip(*(starts >= 0).nonzero(), strict=True):
            others = np.flatnonzero(pool.starts == starts[row, member])
            priors[row, others[others != self.sets[row, member]]] = -np.inf
        return priors


@lru_cache
def _log_on_axes(families: int) -> Float[np.ndarray, " axes"]:
    """Logarithm of the weight of a family of so many that acts on so many axes; 0 where that is no more than one."""
    choices = {2: 3 * families, 3: families}
    several = (log(ON_AXES[axes] * EFFECT_WEIGHT / max(choices[axes], 1)) for axes in (2, 3))
    return np.array([0.0, 0.0, *several])
