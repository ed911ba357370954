"""Prior of sets of causes: of how many at once, of each kind, and of those that come together."""

from math import lgamma, log

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.pool import Pool
from tumblecal.diagnosis.tuning import EFFECT_WEIGHT, FAULT_WEIGHTS, ON_AXES, SEVERAL_OUTLIERS, SIZE_PRIOR


# Prior of a set of this many causes, for the product of their weights.
_LOG_SIZE = tuple(log(share) + lgamma(size + 1) for size, share in enumerate(SIZE_PRIOR))
# Prior of this many outlying positions as one cause, for the product of their weights.
_SEVERAL = (
    log(share) - (outliers - 1) * log(FAULT_WEIGHTS["outlier_position"]) + lgamma(outliers + 1)
    for outliers, share in sorted(SEVERAL_OUTLIERS.items())
)
_LOG_TOGETHER = (0.0, 0.0, *_SEVERAL)


def log_prior(pool: Pool, members: tuple[int, ...]) -> float:
    """Log prior of a set."""
    return counted_log_prior(pool, members)[1]


def counted_log_prior(pool: Pool, members: tuple[int, ...]) -> tuple[int, float]:
    """How many causes a set counts for, and its log prior."""
    count, weight = causes_of(pool, members)
    return count, _LOG_SIZE[count] + weight


def log_priors_with_each(pool: Pool, own: tuple[int, ...]) -> Float[np.ndarray, " causes"]:
    """Log prior of a set with each further candidate; -inf for an effect of the set from another start."""
    count, weight = causes_of(pool, own)
    prior = (_LOG_SIZE[count + 1] + weight) + pool.log_weights
    outliers = sum(k in pool.outlying for k in own)
    if outliers:
        more = _LOG_TOGETHER[outliers + 1] - _LOG_TOGETHER[outliers]
        prior = np.where(pool.is_outlier, _LOG_SIZE[count] + weight + pool.log_weights + more, prior)
    for k in set().union(*pool.families_of(own)) - set(own):
        prior[k] = log_prior(pool, (*own, k))
    for k in own:
        prior[pool.other_starts.get(k, [])] = -np.inf
    return prior


def log_priors_beside(
    pool: Pool, own: tuple[int, ...], log_weights: Float[np.ndarray, " further"]
) -> Float[np.ndarray, " further"]:
    """Log prior of a set with a further cause of each of these log weights that comes together with none of the set."""
    count, weight = causes_of(pool, own)
    return (_LOG_SIZE[count + 1] + weight) + log_weights


def causes_of(pool: Pool, members: tuple[int, ...]) -> tuple[int, float]:
    """How many causes a set counts for, and the logarithm of their weights; axes of a family are one cause, and so are
    outlying positions."""
    single, count, weight = set(members), 0, 0.0
    for axes in pool.families_of(members):
        together = axes & single
        if len(together) > 1:
            choices = pool.axis_families * (1 if len(together) == 3 else 3)
            count, weight = count + 1, weight + log(ON_AXES[len(together)] * EFFECT_WEIGHT / choices)
            single -= together
    outliers = len(single & pool.outlying)
    count += len(single) - max(outliers - 1, 0)
    return count, weight + sum(float(pool.log_weights[k]) for k in single) + _LOG_TOGETHER[outliers]
