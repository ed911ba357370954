"""Prior of sets of causes: of how many at once, of each kind, and of those that come together."""

from functools import lru_cache
from math import lgamma, log

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.cause_sets import MOST, Members, rows_of
from tumblecal.diagnosis.pool import Pool
from tumblecal.diagnosis.tuning import EFFECT_WEIGHT, FAULT_WEIGHTS, ON_AXES, SEVERAL_OUTLIERS, SIZE_PRIOR


# Prior of a set of this many causes, for the product of their weights.
_LOG_SIZE = np.array([log(share) + lgamma(size + 1) for size, share in enumerate(SIZE_PRIOR)])
# Prior of this many outlying positions as one cause, for the product of their weights.
_SEVERAL = (
    log(share) - (outliers - 1) * log(FAULT_WEIGHTS["outlier_position"]) + lgamma(outliers + 1)
    for outliers, share in sorted(SEVERAL_OUTLIERS.items())
)
_LOG_TOGETHER = np.array([0.0, 0.0, *_SEVERAL])
# Which members of a set stand before each.
_BEFORE = np.tri(MOST + 1, k=-1, dtype=bool)


def log_prior(pool: Pool, members: Members) -> float:
    """Log prior of a set."""
    return float(log_priors(pool, rows_of([members]))[0])


def log_priors(pool: Pool, sets: Int[np.ndarray, "sets most"]) -> Float[np.ndarray, " sets"]:
    """Log prior of each set, given as a row."""
    return counted_log_priors(pool, sets)[1]


def counted_log_priors(
    pool: Pool, sets: Int[np.ndarray, "sets most"]
) -> tuple[Int[np.ndarray, " sets"], Float[np.ndarray, " sets"]]:
    """How many causes each set counts for, and its log prior."""
    count, weight, _ = _counted(pool, sets)
    return count, _LOG_SIZE[count] + weight


def log_priors_with_each(pool: Pool, sets: Int[np.ndarray, "sets most"]) -> Float[np.ndarray, "sets causes"]:
    """Log prior of each set with each further candidate; -inf for an effect of the set from another start."""
    count, weight, outliers = _counted(pool, sets)
    priors = (_LOG_SIZE[count + 1] + weight)[:, None] + pool.log_weights
    if np.any(outliers):
        # One more outlying position is no further cause.
        rows, further = np.nonzero((outliers > 0)[:, None] & pool.is_outlier)
        several = _LOG_TOGETHER[outliers + 1] - _LOG_TOGETHER[outliers]
        priors[rows, further] = (_LOG_SIZE[count] + weight + several)[rows] + pool.log_weights[further]
    there = sets >= 0
    family = np.where(there, pool.family[sets], -1)
    if np.any(family >= 0):
        rows, member = np.nonzero(family >= 0)
        rows, further = np.repeat(rows, 3), pool.axes[family[rows, member]].ravel()
        new = ~np.any(sets[rows] == further[:, None], axis=1)
        rows, further = rows[new], further[new]
        priors[rows, further] = log_priors(pool, np.concatenate([sets[rows], further[:, None]], axis=1))
    rows, member = np.nonzero(there & (pool.starts[sets] >= 0))
    own = sets[rows, member]
    pairs, other = np.nonzero(pool.starts[own][:, None] == pool.starts)
    kept = own[pairs] != other
    priors[rows[pairs[kept]], other[kept]] = -np.inf
    return priors


def log_priors_beside(
    pool: Pool, sets: Int[np.ndarray, "sets most"], log_weights: Float[np.ndarray, " further"]
) -> Float[np.ndarray, "sets further"]:
    """Log prior of each set with a further cause of each of these log weights that comes together with none of the set."""
    count, weight, _ = _counted(pool, sets)
    return (_LOG_SIZE[count + 1] + weight)[:, None] + log_weights


def _counted(
    pool: Pool, sets: Int[np.ndarray, "sets most"]
) -> tuple[Int[np.ndarray, " sets"], Float[np.ndarray, " sets"], Int[np.ndarray, " sets"]]:
    """How many causes each set counts for, the logarithm of their weights, and the number of outlying positions; axes of a
    family are one cause, and so are outlying positions."""
    there = sets >= 0
    family = np.where(there, pool.family[sets], -1)
    same = (family[:, :, None] == family[:, None, :]) & (family >= 0)[:, :, None]
    axes = same.sum(axis=2)
    # Of the axes of a family the first stands for all.
    stands = there & ~np.any(same & _BEFORE[: sets.shape[1], : sets.shape[1]], axis=2)
    each = np.where(axes > 1, _log_on_axes(len(pool.axes))[axes], pool.log_weights[sets])
    outliers = (pool.is_outlier[sets] & there).sum(axis=1)
    count = stands.sum(axis=1) - np.maximum(outliers - 1, 0)
    return count, np.where(stands, each, 0.0).sum(axis=1) + _LOG_TOGETHER[outliers], outliers


@lru_cache
def _log_on_axes(families: int) -> Float[np.ndarray, " axes"]:
    """Logarithm of the weight of a family of so many that acts on so many axes; 0 where that is no more than one."""
    choices = {2: 3 * families, 3: families}
    several = (log(ON_AXES[axes] * EFFECT_WEIGHT / max(choices[axes], 1)) for axes in (2, 3))
    return np.array([0.0, 0.0, *several])
