"""Decisions of the diagnosis on many residual vectors of one plan: detected, named, identified.

The diagnosis searches all sets of causes. If one effect alone is there, the sets that count are every single cause, the effect
with one cause more, other noise, and lack of fit. These are evaluated here for all vectors together, by the formulas and with
the numbers of the diagnosis.
"""

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.diagnosis.causes.identities import one_function_at_1_g
from tumblecal.diagnosis.detection.detect import statistics
from tumblecal.diagnosis.lack_of_fit.evidence import mean_over_sizes
from tumblecal.diagnosis.priors import (
    INDISTINGUISHABLE,
    LACK_OF_FIT_WEIGHT,
    LEAST_ODDS,
    NEGLIGIBLE,
    SURE,
)
from tumblecal.diagnosis.sets.cause_sets import Members, rows_of
from tumblecal.diagnosis.sets.partial_set import PartialSets, with_each
from tumblecal.diagnosis.sets.prior import SetPriors
from tumblecal.full_model.evidence import log_evidence_of_noise
from tumblecal.full_model.priors import SIZE_PRIOR
from tumblecal.plan.forecast.effects_of_plan import EffectsOfPlan


def detections(of: EffectsOfPlan, z: Float[np.ndarray, "draws nu"]) -> Bool[np.ndarray, " draws"]:
    """Whether each of some vectors contradicts the nominal model."""
    statistic = statistics(of.pool, None, z, True)
    # The alternatives only add to the statistic: most vectors need none of them.
    rest = np.flatnonzero(statistic <= of.threshold)
    if len(rest):
        none = log_evidence_of_noise(np.vecdot(z[rest], z[rest]), of.pool.dof, True)
        added = np.logaddexp.reduce(of.alternatives.test_log_evidence(z[rest], True), axis=1) - none
        statistic[rest] = np.logaddexp(statistic[rest], added)
    return statistic > of.threshold


def decisions(of: EffectsOfPlan, id: str, z: Float[np.ndarray, "draws nu"]) -> Bool[np.ndarray, "3 draws"]:
    """Decisions on vectors in which an effect is present: whether something is detected; whether the effect is named by the
    leading explanation or one that the data cannot separate from it; whether it is identified, the only cause (identities at
    1 g aside).

    The verdict is `identified` where the leading cause, those identical at 1 g and further powers of its polynomial have
    together a probability of `SURE`.
    """
    pool, own, decided = of.pool, of.causes(id), np.zeros((3, len(z)), bool)
    decided[0] = detections(of, z)
    here = np.flatnonzero(decided[0])
    if not (len(own) and len(here)):
        return decided
    z = z[here]
    singles, (noise, lack) = _with_each(of, (), z), _alternatives(of, z)
    start = int(own[np.argmax(singles[:, own].max(axis=0))])
    right = [*own.tolist(), *identities(of, start)]
    with_another, polynomial = _with_each(of, (start,), z), pool.together.polynomial
    powers = pool.effects[
        (polynomial[pool.effects] == polynomial[start]) & (polynomial[start] >= 0) & (pool.effects != start)
    ]
    others = np.setdiff1d(np.flatnonzero(pool.is_named), right)
    none = log_evidence_of_noise(np.vecdot(z, z), pool.dof, True) + np.log(SIZE_PRIOR[0])
    unnamed = _sum(singles[:, ~pool.is_named], lack)
    alternative = np.max([singles[:, others].max(axis=1, initial=-np.inf), noise[:, 0], unnamed], axis=0)
    leading = np.maximum(_sum(singles[:, own]), singles[:, right].max(axis=1))
    together = with_another[:, pool.is_named].max(axis=1)
    claimed = _sum(singles[:, right], with_another[:, powers])
    total = _sum(none[:, None], singles, with_another, noise, lack)
    named = np.maximum(leading, together) >= alternative
    rest = np.flatnonzero(~named)
    named[rest] = _imitates(of, start, z[rest], singles[rest], _sum(singles[:, own])[rest])
    decided[1, here] = named
    decided[2, here] = (leading >= np.maximum(alternative, together)) & (claimed - total >= np.log(SURE))
    return decided


def identities(of: EffectsOfPlan, own: int) -> list[int]:
    """The other effects that are one function with an effect at 1 g."""
    slots = of.pool.slots
    others = [k for k in of.pool.effects.tolist() if slots[k].id != slots[own].id]
    return [k for k in others if one_function_at_1_g((slots[own],), (slots[k],))]


def _sum(*parts: Float[np.ndarray, "draws sets"]) -> Float[np.ndarray, " draws"]:
    """Logarithm of the sum over all sets."""
    return np.logaddexp.reduce(np.concatenate(parts, axis=1), axis=1)


def _with_each(
    of: EffectsOfPlan, members: Members, z: Float[np.ndarray, "draws nu"]
) -> Float[np.ndarray, "draws causes"]:
    """Log posterior of a set with each further cause, for every vector."""
    pool, count = of.pool, len(z)
    blocks = np.concatenate([np.zeros((0, pool.dof)), *(of.block(k).T for k in members)])
    bases = PartialSets(
        [members] * count,
        z,
        np.broadcast_to(blocks, (count, *blocks.shape)),
        (0, *([len(blocks)] if members else [])),
        np.full((count, len(members)), len(blocks)),
    )
    return with_each(pool, True, bases) + SetPriors.of(pool, rows_of([members])).with_each()


def _alternatives(
    of: EffectsOfPlan, z: Float[np.ndarray, "draws nu"]
) -> tuple[Float[np.ndarray, "draws 1"], Float[np.ndarray, "draws 1"]]:
    """Log posteriors of other noise, and of lack of fit."""
    noise, lack = of.alternatives.noise, of.alternatives.lack
    processes = mean_over_sizes(lack.by_size(z, True)) + lack.log_shares[:, None]
    each = noise.log_evidence(z, True), processes.T + np.log(LACK_OF_FIT_WEIGHT)
    one, nothing = np.log(SIZE_PRIOR[1]), np.full((len(z), 1), -np.inf)
    by_noise, by_lack = (_sum(nothing, values)[:, None] + one for values in each)
    return by_noise, by_lack


def _imitates(
    of: EffectsOfPlan,
    own: int,
    z: Float[np.ndarray, "draws nu"],
    singles: Float[np.ndarray, "draws causes"],
    effect: Float[np.ndarray, " draws"],
) -> Bool[np.ndarray, " draws"]:
    """Whether the effect counts as equivalent to the leading single cause: no less probable than `LEAST_ODDS` allows, priors
    aside, and able to make its signal."""
    pool, leading, block = of.pool, np.argmax(singles, axis=1), of.block(own)
    found = np.zeros(len(z), bool)
    for k in np.unique(leading).tolist():
        here, cause = leading == k, pool.causes[k]
        if cause.block is not None:
            signal = z[here] @ cause.block @ cause.block.T
            rest = signal - signal @ block @ block.T
            least = LEAST_ODDS + cause.log_weight - pool.causes[own].log_weight if cause.named else NEGLIGIBLE
            found[here] = (singles[here, k] - effect[here] <= least) & (np.vecdot(rest, rest) < INDISTINGUISHABLE**2)
    return found
