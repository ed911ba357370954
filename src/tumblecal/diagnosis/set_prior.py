"""Prior of sets of causes: of how many at once, of each kind, and of those that come together."""

import numpy as np
from jaxtyping import Float
from scipy.special import gammaln

from tumblecal.diagnosis.pool import Pool
from tumblecal.diagnosis.tuning import EFFECT_WEIGHT, FAULT_WEIGHTS, ON_AXES, SEVERAL_OUTLIERS, SIZE_PRIOR


def log_prior(pool: Pool, members: tuple[int, ...]) -> float:
    """Log prior of a set."""
    count, weight = causes_of(pool, members)
    return _log_size(count) + weight


def log_priors_with_each(pool: Pool, own: tuple[int, ...]) -> Float[np.ndarray, " causes"]:
    """Log prior of a set with each further candidate; -inf for an effect of the set from another start."""
    count, weight = causes_of(pool, own)
    prior = log_priors_beside(pool, own, pool.log_weights)
    outliers = int(np.sum(pool.is_outlier[list(own)]))
    if outliers:
        more = _log_together(outliers + 1) - _log_together(outliers)
        prior = np.where(pool.is_outlier, _log_size(count) + weight + pool.log_weights + more, prior)
    for k in set().union(*pool.families_of(own)) - set(own):
        count, weight = causes_of(pool, (*own, k))
        prior[k] = _log_size(count) + weight
    for k in own:
        prior[pool.other_starts.get(k, [])] = -np.inf
    return prior


def log_priors_beside(
    pool: Pool, own: tuple[int, ...], log_weights: Float[np.ndarray, " further"]
) -> Float[np.ndarray, " further"]:
    """Log prior of a set with a further cause of each of these log weights that comes together with none of the set."""
    count, weight = causes_of(pool, own)
    return _log_size(count + 1) + weight + log_weights


def causes_of(pool: Pool, members: tuple[int, ...]) -> tuple[int, float]:
    """How many causes a set counts for, and the logarithm of their weights; axes of a family are one cause, and so are
    outlying positions."""
    single, count, weight = set(members), 0, 0.0
    for axes in pool.families_of(members):
        together = axes & single
        if len(together) > 1:
            choices = pool.axis_families * (1 if len(together) == 3 else 3)
            count, weight = count + 1, weight + np.log(ON_AXES[len(together)] * EFFECT_WEIGHT / choices)
            single -= together
    outliers = int(np.sum(pool.is_outlier[list(single)]))
    count += len(single) - max(outliers - 1, 0)
    return count, float(weight + pool.log_weights[list(single)].sum() + _log_together(outliers))


def _log_together(outliers: int) -> float:
    """Prior of this many outlying positions as one cause, for the product of their weights."""
    if outliers < 2:
        return 0.0
    kind = np.log(FAULT_WEIGHTS["outlier_position"])
    return float(np.log(SEVERAL_OUTLIERS[outliers]) - (outliers - 1) * kind + gammaln(outliers + 1))


def _log_size(size: int) -> float:
    """Prior of a set of this many causes, for the product of their weights."""
    return float(np.log(SIZE_PRIOR[size]) + gammaln(size + 1))
