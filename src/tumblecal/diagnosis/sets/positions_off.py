"""Two or three outlier positions, or one with an effect, that hide each other in unknown noise.

Of all sets of a kind (for three positions: the best pairs with each other position), the one whose removal leaves the smallest
residual is selected. The residual without a given set is Beta-distributed if there is no error. The number of all sets of its
kind bounds the p-value of the best of them (Bonferroni).
"""

from math import comb, log

import numpy as np
from jaxtyping import Float
from scipy import special

from tumblecal.diagnosis.causes.table import Pool
from tumblecal.diagnosis.priors import MOST_POSITION_PAIRS, MOST_POSITIONS_BESIDE, WIDTH
from tumblecal.diagnosis.sets.cause_sets import Members
from tumblecal.diagnosis.sets.partial_set import added, partial_sets
from tumblecal.full_model.evidence import LEAST_FREE


def positions_off(pool: Pool, z: Float[np.ndarray, " nu"]) -> tuple[float, list[Members]]:
    """The p-value (upper bound) of the two or three positions, or the one and an effect, whose removal leaves the smallest
    residual; and the best pairs and triples of positions. It is 1, and there are none, if there are so many positions that each
    outlier is visible by itself.

    Positions alone and one with an effect have half of the size each, if both are tested.
    """
    whole = _whole(pool)
    if len(whole) < 2 or comb(len(whole), 2) > MOST_POSITION_PAIRS or not np.any(z):
        return 1.0, []
    alone = [(k,) for k in whole]
    effects = pool.effects.tolist() if len(whole) <= MOST_POSITIONS_BESIDE else []
    logs = _log_shares_left(pool, z, alone, [*effects, *whole])
    with_effects, pairs = logs[:, : len(effects)], np.triu(logs[:, len(effects) :], 1)
    best = np.argsort(pairs, axis=None, kind="stable")[:WIDTH].tolist()
    found = [(whole[k // len(whole)], whole[k % len(whole)]) for k in best if pairs.flat[k] < 0.0]
    of_threes = _log_shares_left(pool, z, found, whole) if found else np.zeros((0, len(whole)))
    listed = {
        tuple(sorted((*pair, other))): float(value)
        for pair, row in zip(found, of_threes, strict=True)
        for other, value in zip(whole, row, strict=True)
        if other not in pair
    }
    # The bound (log) of two or three positions, each at half of the size.
    bound = min(
        log(2 * comb(len(whole), 2)) + float(pairs.min()),
        log(2 * max(comb(len(whole), 3), 1)) + min(listed.values(), default=0.0),
    )
    if effects:
        bound = log(2) + min(bound, log(with_effects.size) + float(with_effects.min()))
    threes = sorted(listed, key=listed.__getitem__)[:WIDTH]
    return float(np.exp(min(0.0, bound))), [*found, *threes]


def _log_shares_left(
    pool: Pool, z: Float[np.ndarray, " nu"], sets: list[Members], others: list[int]
) -> Float[np.ndarray, "sets others"]:
    """Log probability, where nothing is wrong, that so small a share is left without each set and each further cause."""
    near = pool.only(np.array(sorted(others)))
    bases = partial_sets(pool, z, sets)
    rest = np.vecdot(bases.rest, bases.rest)[:, None]
    left, taken = np.repeat(rest, near.size, axis=1), np.zeros((len(sets), near.size), int)
    for moves, explained, counts in added(near, bases, near.moves):
        left[:, moves.numbers] -= explained.sum(axis=0)
        taken[:, moves.numbers] = counts.sum(axis=0) + bases.ranks.sum(axis=1)[:, None]
    free = pool.dof - taken
    share = np.clip(left / (z @ z), 0.0, 1.0)
    below = special.betainc(np.maximum(free, 1) / 2, np.maximum(taken, 1) / 2, share)
    logs = np.where((free >= LEAST_FREE) & (taken > 0), np.log(np.maximum(below, 1e-300)), 0.0)
    return logs[:, np.argsort(np.argsort(others))]


def _whole(pool: Pool) -> list[int]:
    """Of each position the candidate that takes all its readings."""
    whole: dict[str, int] = {}
    for k in np.flatnonzero(pool.is_outlier).tolist():
        other = whole.setdefault(pool.labels[k], k)
        if pool.ranks[k] > pool.ranks[other]:
            whole[pool.labels[k]] = k
    return sorted(whole.values())
