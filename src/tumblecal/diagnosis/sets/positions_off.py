"""Two or three outlier positions, or one with an effect, that hide each other in unknown noise.

Of all sets of a kind (for three positions: the best pairs with each other position), the one whose removal leaves the smallest
residual is selected. The residual without a given set is Beta-distributed if there is no error. The number of all sets of its
kind bounds the p-value of the best of them (Bonferroni).
"""

from itertools import combinations
from math import comb, log

import numpy as np
from jaxtyping import Float, Int
from scipy import special

from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.priors import MOST_POSITION_PAIRS, MOST_POSITIONS_BESIDE, WIDTH
from tumblecal.diagnosis.sets.cause_sets import Members
from tumblecal.diagnosis.sets.partial_set import least_left
from tumblecal.full_model.evidence import LEAST_FREE


def positions_off(pool: Pool, z: Float[np.ndarray, " nu"]) -> float:
    """The p-value (upper bound) of the two or three positions, or the one and an effect, whose removal leaves the smallest
    residual. It is 1 if there are so many positions that each outlier is visible by itself.

    Positions alone and one with an effect have half of the size each, if both are tested.
    """
    whole = _whole(pool)
    if len(whole) < 2 or comb(len(whole), 2) > MOST_POSITION_PAIRS or not np.any(z):
        return 1.0
    # The bound (log) of two or three positions, each at half of the size.
    alone = min(
        log(2 * comb(len(whole), sets.shape[1])) + float(logs.min(initial=0.0))
        for sets, logs in _pairs_and_threes(pool, z, whole)
        if len(logs)
    )
    effects = pool.effects if len(whole) <= MOST_POSITIONS_BESIDE else pool.effects[:0]
    if not len(effects):
        return float(np.exp(min(0.0, alone)))
    beside = np.stack(np.meshgrid(effects, whole, indexing="ij"), axis=-1).reshape(-1, 2)
    bound = log(len(beside)) + float(_log_shares_left(pool, z, beside).min(initial=0.0))
    return float(np.exp(min(0.0, log(2) + min(alone, bound))))


def off_together(pool: Pool, z: Float[np.ndarray, " nu"]) -> list[Members]:
    """The best pairs and triples of outlier positions, by the residual without them; none if there are so many positions that
    each outlier is visible by itself."""
    whole = _whole(pool)
    if len(whole) < 2 or comb(len(whole), 2) > MOST_POSITION_PAIRS:
        return []
    sets = (
        sets[np.argsort(logs, kind="stable")[:WIDTH]] for sets, logs in _pairs_and_threes(pool, z, whole) if len(sets)
    )
    return [tuple(sorted(own)) for best in sets for own in best.tolist()]


def _pairs_and_threes(
    pool: Pool, z: Float[np.ndarray, " nu"], whole: Int[np.ndarray, " positions"]
) -> list[tuple[Int[np.ndarray, "sets number"], Float[np.ndarray, " sets"]]]:
    """All pairs, and the best of them with each other position; log probabilities as of `_log_shares_left`."""
    pairs = np.array([*combinations(whole.tolist(), 2)])
    of_pairs = _log_shares_left(pool, z, pairs)
    best = pairs[np.argsort(of_pairs, kind="stable")[:WIDTH]].tolist()
    threes = {tuple(sorted((*pair, other))) for pair in best for other in whole.tolist() if other not in pair}
    listed = np.array(sorted(threes), int).reshape(-1, 3)
    return [(pairs, of_pairs), (listed, _log_shares_left(pool, z, listed))]


def _log_shares_left(
    pool: Pool, z: Float[np.ndarray, " nu"], sets: Int[np.ndarray, "sets number"]
) -> Float[np.ndarray, " sets"]:
    """Log probability, where nothing is wrong, that so small a share is left without each set."""
    if not len(sets):
        return np.zeros(0)
    left, ranks = least_left(pool, z, sets)
    taken = ranks.sum(axis=1)
    free = pool.dof - taken
    below = special.betainc(np.maximum(free, 1) / 2, taken / 2, np.minimum(left / (z @ z), 1.0))
    return np.where(free >= LEAST_FREE, np.log(np.maximum(below, 1e-300)), 0.0)


def _whole(pool: Pool) -> Int[np.ndarray, " positions"]:
    """Of each position the cause that takes all its readings."""
    whole: dict[str, int] = {}
    for k in np.flatnonzero(pool.is_outlier).tolist():
        other = whole.setdefault(pool.labels[k], k)
        if pool.ranks[k] > pool.ranks[other]:
            whole[pool.labels[k]] = k
    return np.array(sorted(whole.values()), int)
