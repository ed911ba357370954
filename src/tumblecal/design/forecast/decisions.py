"""Decisions of the diagnosis on many residual vectors of one plan: detected, named, identified.

The diagnosis searches all sets of causes. If one effect alone is there, the sets that count are every single cause, the most
probable ones with one cause more, their families, other noise, and lack of fit. These are evaluated here for all vectors
together, by the formulas and with the numbers of the diagnosis.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.design.forecast.effects_of_plan import EffectsOfPlan
from tumblecal.diagnosis.causes.generic import UNEXPLAINED
from tumblecal.diagnosis.causes.identities import one_function_at_1_g
from tumblecal.diagnosis.detection.detect import statistics
from tumblecal.diagnosis.findings.location import parts_of_effect
from tumblecal.diagnosis.lack_of_fit.components import mean_over_sizes
from tumblecal.diagnosis.priors import (
    INDISTINGUISHABLE,
    LACK_OF_FIT_WEIGHT,
    LEAST_LOCATED_ODDS,
    LEAST_ODDS,
    NEGLIGIBLE,
    PROMISING,
    SURE,
)
from tumblecal.diagnosis.sets.cause_sets import Members, rows_of
from tumblecal.diagnosis.sets.enlarged import Enlarged
from tumblecal.diagnosis.sets.partial_set import PartialSets, partial_sets
from tumblecal.diagnosis.sets.prior import SetPriors
from tumblecal.full_model.evidence import log_evidence, log_evidence_of_noise
from tumblecal.full_model.priors import SIZE_PRIOR


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
    """Which vectors in which something is detected name an effect with these numbers (one for each start), and identify it."""
    singles, (noise, lack) = _with_each(of, (), z), _alternatives(of, z)
    right = [*own, *identities(of, own[int(np.argmax(singles[:, own].max(axis=0)))])]
    leading = np.array(right)[np.argmax(singles[:, right], axis=1)]
    named, identified = np.zeros((2, len(z)), bool)
    for start in np.unique(leading).tolist():
        here = np.flatnonzero(leading == start)
        given = z[here], singles[here], noise[here], lack[here]
        named[here], identified[here] = _named_with(of, start, own, right, *given)
    return named, identified


def _named_with(
    of: EffectsOfPlan,
    start: int,
    own: list[int],
    right: list[int],
    z: Float[np.ndarray, "draws nu"],
    singles: Float[np.ndarray, "draws causes"],
    noise: Float[np.ndarray, "draws labels"],
    lack: Float[np.ndarray, " draws"],
) -> tuple[Bool[np.ndarray, " draws"], Bool[np.ndarray, " draws"]]:
    """`_named` of vectors of which the cause `start` of those that are `right` is the most probable.

    The verdict is `identified` where the leading cause, what is identical at 1 g and further powers of its polynomial have
    together a probability of `SURE`, and the effect in a part of the data alone is not more probable.
    """
    pool = of.pool
    with_another, family = _with_each(of, (start,), z), _of_sets(of, start, _families(of, start), z)
    none = log_evidence_of_noise(np.vecdot(z, z), pool.dof, True) + np.log(SIZE_PRIOR[0])
    others = np.setdiff1d(np.flatnonzero(pool.is_named), right)
    together = np.concatenate([with_another[:, pool.is_named], family], axis=1).max(axis=1)
    named_other = np.concatenate([_by_label(of, singles, others), noise], axis=1).max(axis=1)
    alternative = np.max([named_other, _sum(singles[:, ~pool.is_named], lack[:, None])], axis=0)
    leading = np.maximum(_sum(singles[:, own]), singles[:, right].max(axis=1))
    same = _of_sets(of, start, _identical_sets(of, start), z)
    claimed = _sum(singles[:, right], with_another[:, _powers(of, start)], same)
    total = _sum(none[:, None], singles, with_another, family, noise, lack[:, None])
    identified = (leading >= np.maximum(alternative, together)) & (claimed - total >= np.log(SURE))
    identified &= _in_a_part(of, start, z) - singles[:, start] <= LEAST_LOCATED_ODDS
    sure = np.flatnonzero(identified)
    total[sure] = np.logaddexp(total[sure], _sets_without(of, start, z[sure], singles[sure]))
    identified[sure] = claimed[sure] - total[sure] >= np.log(SURE)
    named = np.maximum(leading, together) >= alternative
    rest = np.flatnonzero(~named)
    named[rest] = _imitates(of, start, z[rest], singles[rest], _sum(singles[:, own])[rest])
    return named, identified


def _sets_without(
    of: EffectsOfPlan, start: int, z: Float[np.ndarray, "draws nu"], singles: Float[np.ndarray, "draws causes"]
) -> Float[np.ndarray, " draws"]:
    """Logarithm of the sum over sets of several causes without `start`: every other cause that is not far behind the best with
    one cause more, and its families. Each set is counted once, by the first of its causes."""
    pool, total = of.pool, np.full(len(z), -np.inf)
    near = singles >= singles.max(axis=1, keepdims=True) - PROMISING
    near[:, np.setdiff1d(np.arange(pool.size), pool.blocks)] = near[:, start] = False
    for cause in np.flatnonzero(near.any(axis=0)).tolist():
        here = np.flatnonzero(near[:, cause])
        pairs = _with_each(of, (cause,), z[here])
        pairs[:, :cause][near[here, :cause]] = pairs[:, start] = -np.inf
        families = [own for own in _families(of, cause) if start not in own]
        before = [[other for other in own if other < cause] for own in families]
        counted = np.stack([near[here][:, own].any(axis=1) for own in before], axis=1) if families else False
        of_families = np.where(counted, -np.inf, _of_sets(of, cause, families, z[here]))
        total[here] = np.logaddexp(total[here], _sum(pairs, of_families))
    return total


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


def _of_sets(
    of: EffectsOfPlan, first: int, sets: Sequence[Members], z: Float[np.ndarray, "draws nu"]
) -> Float[np.ndarray, "draws sets"]:
    """Log posterior of some sets, causes like the first one first in the order of what they explain."""
    pool, scores = of.pool, [np.zeros((len(z), 0))]
    for members in sets:
        bases = partial_sets(pool, of.block(first).sum(axis=1), [members])
        along = (z @ bases.q[0].T) ** 2
        parts = [(along[:, rows].sum(axis=1), rank) for rows, rank in zip(bases.segments, bases.ranks[0], strict=True)]
        evidence = log_evidence(np.vecdot(z, z), parts, pool.dof, True)
        scores.append(evidence[:, None] + SetPriors.of(pool, rows_of([members])).own)
    return np.concatenate(scores, axis=1)


def _families(of: EffectsOfPlan, own: int) -> list[Members]:
    """The families of an effect on all axes."""
    return [tuple(sorted(axes)) for axes in of.pool.axes.tolist() if own in axes]


def _identical_sets(of: EffectsOfPlan, own: int) -> list[Members]:
    """Families on two or three axes that are one function with an effect at 1 g, and do not contain it."""
    slots, sets = of.pool.slots, [tuple(sorted(axes)) for axes in of.pool.axes.tolist() if own not in axes]
    several = [members for axes in sets for members in (*combinations(axes, 2), axes)]
    return [own_set for own_set in several if one_function_at_1_g((slots[own],), tuple([slots[k] for k in own_set]))]


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
