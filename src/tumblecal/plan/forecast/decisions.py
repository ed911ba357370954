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
from tumblecal.diagnosis.priors import INDISTINGUISHABLE, LACK_OF_FIT_WEIGHT, LEAST_ODDS, NEGLIGIBLE, SURE
from tumblecal.diagnosis.sets.cause_sets import Members, rows_of
from tumblecal.diagnosis.sets.partial_set import PartialSets, with_each
from tumblecal.diagnosis.sets.prior import SetPriors
from tumblecal.full_model.evidence import log_evidence_of_noise
from tumblecal.full_model.priors import SIZE_PRIOR
from tumblecal.plan.forecast.effects_of_plan import EffectsOfPlan


# Residual vectors; whether something is decided on each; log posteriors of some sets for each.
Vectors = Float[np.ndarray, "draws nu"]
Decided = Bool[np.ndarray, "*decisions draws"]
LogPosteriors = Float[np.ndarray, "draws sets"]


def detections(of: EffectsOfPlan, z: Vectors) -> Decided:
    """Whether each of some vectors contradicts the nominal model."""
    statistic = statistics(of.pool, None, z, True)
    # The alternatives only add to the statistic: most vectors need none of them.
    rest = np.flatnonzero(statistic <= of.threshold)
    if len(rest):
        none = log_evidence_of_noise(np.vecdot(z[rest], z[rest]), of.pool.dof, True)
        added = _sum(of.alternatives.test_log_evidence(z[rest], True)) - none
        statistic[rest] = np.logaddexp(statistic[rest], added)
    return statistic > of.threshold


def decisions(of: EffectsOfPlan, id: str, z: Vectors) -> Decided:
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
    singles, others_than_causes = _with_each(of, (), z), _alternatives(of, z)
    start = int(own[np.argmax(singles[:, own].max(axis=0))])
    right = [*own.tolist(), *identities(of, start)]
    with_another, polynomial = _with_each(of, (start,), z), pool.together.polynomial
    same = (polynomial[pool.effects] == polynomial[start]) & (polynomial[start] >= 0)
    powers = pool.effects[same & (pool.effects != start)]
    named, size = pool.is_named, np.log(SIZE_PRIOR[0])
    others = np.setdiff1d(np.flatnonzero(named), right)
    none = log_evidence_of_noise(np.vecdot(z, z), pool.dof, True)[:, None] + size
    unnamed, noise = _sum(singles[:, ~named], others_than_causes[:, 1:]), others_than_causes[:, 0]
    alternative = np.max([singles[:, others].max(axis=1, initial=-np.inf), noise, unnamed], axis=0)
    alone = _sum(singles[:, own])
    leading = np.maximum(alone, singles[:, right].max(axis=1))
    claimed = _sum(singles[:, right], with_another[:, powers])
    total = _sum(none, singles, with_another, others_than_causes)
    together = with_another[:, named].max(axis=1)
    decided[2, here] = (leading >= np.maximum(alternative, together)) & (claimed - total >= np.log(SURE))
    first = np.maximum(leading, together) >= alternative
    rest = np.flatnonzero(~first)
    first[rest] = _imitates(of, start, z[rest], singles[rest], alone[rest])
    decided[1, here] = first
    return decided


def identities(of: EffectsOfPlan, own: int) -> list[int]:
    """The other effects that are one function with an effect at 1 g."""
    slots = of.pool.slots
    others = [k for k in of.pool.effects.tolist() if slots[k].id != slots[own].id]
    return [k for k in others if one_function_at_1_g((slots[own],), (slots[k],))]


def _sum(*parts: LogPosteriors) -> Float[np.ndarray, " draws"]:
    """Logarithm of the sum over all sets."""
    return np.logaddexp.reduce(np.concatenate(parts, axis=1), axis=1)


def _with_each(of: EffectsOfPlan, members: Members, z: Vectors) -> LogPosteriors:
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


def _alternatives(of: EffectsOfPlan, z: Vectors) -> Float[np.ndarray, "draws 2"]:
    """Log posteriors of other noise, and of lack of fit."""
    noise, lack, nothing = of.alternatives.noise, of.alternatives.lack, np.full((len(z), 1), -np.inf)
    processes = mean_over_sizes(lack.by_size(z, True)) + lack.log_shares[:, None]
    each = noise.log_evidence(z, True), processes.T + np.log(LACK_OF_FIT_WEIGHT)
    return np.log(SIZE_PRIOR[1]) + np.stack([_sum(nothing, values) for values in each], axis=1)


def _imitates(
    of: EffectsOfPlan, own: int, z: Vectors, singles: LogPosteriors, effect: Float[np.ndarray, " draws"]
) -> Decided:
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
