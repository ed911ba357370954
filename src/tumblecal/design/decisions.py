"""Decisions of the diagnosis on many residual vectors of one plan: detected, named, identified.

The diagnosis searches all sets of causes. If one effect alone is there, the sets that count are every single cause, the effect
with one cause more, its family, other noise, and lack of fit. These are evaluated here for all vectors together, by the
formulas and with the numbers of the diagnosis.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.design.effects_of_plan import EffectsOfPlan
from tumblecal.diagnosis.causes.generic import UNEXPLAINED
from tumblecal.diagnosis.causes.identities import one_function_at_1_g
from tumblecal.diagnosis.detection.detect import statistics
from tumblecal.diagnosis.evidence import log_evidence, log_evidence_of_noise
from tumblecal.diagnosis.findings.location import parts_of_effect
from tumblecal.diagnosis.lack_of_fit.components import mean_over_sizes
from tumblecal.diagnosis.priors import (
    INDISTINGUISHABLE,
    LACK_OF_FIT_WEIGHT,
    LEAST_LOCATED_ODDS,
    LEAST_ODDS,
    NEGLIGIBLE,
    SIZE_PRIOR,
    SURE,
)
from tumblecal.diagnosis.sets.cause_sets import Members, rows_of
from tumblecal.diagnosis.sets.enlarged import Enlarged
from tumblecal.diagnosis.sets.partial_set import PartialSets, partial_sets
from tumblecal.diagnosis.sets.prior import SetPriors


class Decisions(NamedTuple):
    """For each residual vector: whether something is detected; whether the effect is named by the leading explanation or one
    that the data cannot separate from it; whether it is identified, the only cause (identities at 1 g aside)."""

    detected: Bool[np.ndarray, " draws"]
    named: Bool[np.ndarray, " draws"]
    identified: Bool[np.ndarray, " draws"]


def detections(of: EffectsOfPlan, z: Float[np.ndarray, "draws nu"]) -> Bool[np.ndarray, " draws"]:
    """Whether each of some vectors contradicts the nominal model."""
    return statistics(of.pool, of.alternatives, z, True) > of.threshold


def decisions(of: EffectsOfPlan, id: str, z: Float[np.ndarray, "draws nu"]) -> Decisions:
    """Decisions on vectors in which an effect is present."""
    own, detected = of.causes(id).tolist(), detections(of, z)
    named, identified = np.zeros((2, len(z)), bool)
    here = np.flatnonzero(detected)
    if own and len(here):
        named[here], identified[here] = _named(of, own, z[here])
    return Decisions(detected, named, identified)


def _named(
    of: EffectsOfPlan, own: list[int], z: Float[np.ndarray, "draws nu"]
) -> tuple[Bool[np.ndarray, " draws"], Bool[np.ndarray, " draws"]]:
    """Which vectors in which something is detected name an effect with these numbers (one for each start), and identify it.

    The verdict is `identified` where the leading cause, what is identical at 1 g and further powers of its polynomial have
    together a probability of `SURE`, and the effect in a part of the data alone is not more probable.
    """
    pool = of.pool
    singles = _with_each(of, (), z)
    start = own[int(np.argmax(singles[:, own].max(axis=0)))]
    with_another, family = _with_each(of, (start,), z), _family(of, start, z)
    noise, lack = _alternatives(of, z)
    none = log_evidence_of_noise(np.vecdot(z, z), pool.dof, True) + np.log(SIZE_PRIOR[0])
    right = [*own, *identities(of, start)]
    others = np.setdiff1d(np.flatnonzero(pool.is_named), right)
    alone = _sum(singles[:, others], singles[:, ~pool.is_named], lack[:, None])
    # Every other cause has sets with one cause more too; they have about the share that those of the effect have.
    further = alone + np.minimum(_sum(with_another) - _sum(singles[:, own]), 0.0)
    total = _sum(none[:, None], singles, with_another, family, noise, lack[:, None], further[:, None])
    together = np.concatenate([with_another[:, pool.is_named], family], axis=1).max(axis=1)
    named_other = np.concatenate([_by_label(of, singles, others), noise], axis=1).max(axis=1)
    alternative = np.max([named_other, _sum(singles[:, ~pool.is_named], lack[:, None])], axis=0)
    leading = np.maximum(_sum(singles[:, own]), singles[:, right].max(axis=1))
    claimed = _sum(singles[:, right], with_another[:, _powers(of, start)])
    identified = (leading >= np.maximum(alternative, together)) & (claimed - total >= np.log(SURE))
    identified &= _in_a_part(of, start, z) - singles[:, start] <= LEAST_LOCATED_ODDS
    named = np.maximum(leading, together) >= alternative
    rest = np.flatnonzero(~named)
    named[rest] = _imitates(of, start, z[rest], singles[rest], _sum(singles[:, own])[rest])
    return named, identified


def _sum(*parts: Float[np.ndarray, "draws sets"]) -> Float[np.ndarray, " draws"]:
    """Logarithm of the sum over all sets."""
    return np.logaddexp.reduce(np.concatenate(parts, axis=1), axis=1)


def _with_each(
    of: EffectsOfPlan, members: Members, z: Float[np.ndarray, "draws nu"]
) -> Float[np.ndarray, "draws causes"]:
    """Log posterior of a set with each further cause, for every vector; bounds of what is negligible."""
    pool, count = of.pool, len(z)
    blocks = np.concatenate([of.block(k).T for k in members]) if members else np.zeros((0, pool.dof))
    bases = PartialSets(
        [members] * count,
        z,
        np.broadcast_to(blocks, (count, *blocks.shape)),
        (0, *([len(blocks)] if members else [])),
        np.full((count, len(members)), len(blocks)),
    )
    enlarged = Enlarged(pool, True, bases)
    priors = SetPriors.of(pool, rows_of([members])).with_each()
    if members:
        priors[:, list(members)] = -np.inf
    scores = enlarged.evidence + priors
    enlarged.settle(scores >= scores.max(axis=1, keepdims=True) - NEGLIGIBLE / 2)
    return np.where(enlarged.open, -np.inf, enlarged.evidence + priors)


def _family(of: EffectsOfPlan, own: int, z: Float[np.ndarray, "draws nu"]) -> Float[np.ndarray, "draws families"]:
    """Log posterior of the effect's family on all axes, the effect first in the order of what they explain."""
    pool, scores = of.pool, [np.zeros((len(z), 0))]
    for members in (tuple(sorted(axes)) for axes in pool.axes.tolist() if own in axes):
        sets = partial_sets(pool, of.block(own).sum(axis=1), [members])
        along = (z @ sets.q[0].T) ** 2
        parts = [(along[:, rows].sum(axis=1), rank) for rows, rank in zip(sets.segments, sets.ranks[0], strict=True)]
        evidence = log_evidence(np.vecdot(z, z), parts, pool.dof, True)
        scores.append(evidence[:, None] + SetPriors.of(pool, rows_of([members])).own)
    return np.concatenate(scores, axis=1)


def _in_a_part(of: EffectsOfPlan, own: int, z: Float[np.ndarray, "draws nu"]) -> Float[np.ndarray, " draws"]:
    """The highest log posterior of the effect in a part of the data alone: one that is too high makes the verdict doubtful."""
    cut = parts_of_effect(of.at, of.pool, own)
    if not len(cut.causes):
        return np.full(len(z), -np.inf)
    squares, blocks = (z @ cut.stacked) ** 2, cut.blocks
    explained = np.add.reduceat(squares, cut.first_columns[blocks], axis=1)
    total = np.broadcast_to(np.vecdot(z, z)[:, None], explained.shape)
    evidence = log_evidence(total, [(explained, cut.ranks[blocks])], of.pool.dof, True)
    return np.max(evidence + cut.log_weights[blocks], axis=1) + float(np.log(SIZE_PRIOR[1]))


def _alternatives(
    of: EffectsOfPlan, z: Float[np.ndarray, "draws nu"]
) -> tuple[Float[np.ndarray, "draws labels"], Float[np.ndarray, " draws"]]:
    """Log posteriors of other noise by label, and of lack of fit."""
    others, one = of.alternatives, float(np.log(SIZE_PRIOR[1]))
    values = others.noise.log_evidence(z, True)
    labels = np.array([model.label for model in others.noise.listed], object)
    by_label = {label: np.logaddexp.reduce(values[:, labels == label], axis=1) for label in dict.fromkeys(labels)}
    processes = mean_over_sizes(others.lack.by_size(z, True)) + others.lack.log_shares[:, None]
    # A process of several fields has its share a second time, for one curve in all of them; that gains as much on average.
    twice = np.where(others.lack.listed.kinds.width[others.lack.numbers] > 1, np.log(2.0), 0.0)
    lack = np.logaddexp.reduce(processes + twice[:, None], axis=0, initial=-np.inf) + np.log(LACK_OF_FIT_WEIGHT)
    lack = np.logaddexp(lack, by_label.pop(UNEXPLAINED, -np.inf))
    return np.stack([np.full(len(z), -np.inf), *by_label.values()], axis=1) + one, lack + one


def identities(of: EffectsOfPlan, own: int) -> list[int]:
    """The other effects that are one function with an effect at 1 g."""
    slots = of.pool.slots
    others = [k for k in of.pool.effects.tolist() if slots[k].id != slots[own].id]
    return [k for k in others if one_function_at_1_g((slots[own],), (slots[k],))]


def _powers(of: EffectsOfPlan, own: int) -> list[int]:
    """The other powers of an effect's polynomial."""
    number = of.pool.together.polynomial
    return [k for k in of.pool.effects.tolist() if k != own and number[own] >= 0 and number[k] == number[own]]


def _by_label(
    of: EffectsOfPlan, singles: Float[np.ndarray, "draws causes"], others: Int[np.ndarray, " others"]
) -> Float[np.ndarray, "draws labels"]:
    """Log posteriors of single causes, starts of one effect together."""
    labels = [of.pool.labels[k] for k in others.tolist()]
    number = {label: k for k, label in enumerate(dict.fromkeys(labels))}
    starts = np.array([number[label] for label in labels], int)
    order = np.argsort(starts, kind="stable")
    first = np.searchsorted(starts[order], np.arange(len(number)))
    return np.logaddexp.reduceat(singles[:, others[order]], first, axis=1)


def _imitates(
    of: EffectsOfPlan,
    own: int,
    z: Float[np.ndarray, "draws nu"],
    singles: Float[np.ndarray, "draws causes"],
    effect: Float[np.ndarray, " draws"],
) -> Bool[np.ndarray, " draws"]:
    """Whether the effect counts as equivalent to the leading single cause: no less probable than `LEAST_ODDS` allows, priors
    aside, and able to make its signal."""
    pool, leading = of.pool, np.argmax(singles, axis=1)
    block = of.block(own)
    found = np.zeros(len(z), bool)
    for k in np.unique(leading).tolist():
        here, cause = leading == k, pool.causes[k]
        if cause.block is None:
            continue
        signal = z[here] @ cause.block @ cause.block.T
        rest = signal - signal @ block @ block.T
        odds = singles[here, k] - effect[here]
        of_priors = cause.log_weight - pool.causes[own].log_weight
        near = odds <= (LEAST_ODDS + of_priors if cause.named else NEGLIGIBLE)
        found[here] = near & (np.vecdot(rest, rest) < INDISTINGUISHABLE**2)
    return found
