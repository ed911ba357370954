"""Faults of the procedure as exact alternatives: an outlier position, exchanged positions, an angle in error by a step.

A fault is a function that makes it with its signal and how it is undone, and one that lists its candidates; `FAULTS` names the
latter. Its description is in the catalogue (effects/procedure.py).
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from tumblecal.chain import Where
from tumblecal.diagnosis.causes.cause import Cause, Kind
from tumblecal.diagnosis.causes.exchanged_pairs import exchanged_pairs
from tumblecal.diagnosis.causes.plan_steps import Step, plan_steps
from tumblecal.diagnosis.causes.table import CauseTable, equally_weighted
from tumblecal.diagnosis.priors import (
    FAR,
    FAULT_TEST_WEIGHTS,
    FAULT_WEIGHTS,
    LEAST_SHIFT,
    OTHER_FAULT_TEST_WEIGHT,
    OTHER_FAULT_WEIGHT,
    OUTLIER_VISIBLE,
)
from tumblecal.estimation.problem import Problem
from tumblecal.full_model.tangent import Tangent


# Noise of this many times its level is drawn in none of the tests.
_LARGE_NOISE = 1.5


OUTLIER = Kind("outlier")
SWAP = Kind("swap", fitted=False)
MISLABEL = Kind("mislabel", fitted=False)


def log_weights(id: str, share: float) -> tuple[float, float]:
    """Logarithms of the weights in the posterior and in the test, of a candidate that has this (log) share of its kind."""
    weights = FAULT_WEIGHTS.get(id, OTHER_FAULT_WEIGHT), FAULT_TEST_WEIGHTS.get(id, OTHER_FAULT_TEST_WEIGHT)
    return share + float(np.log(weights[0])), share + float(np.log(weights[1]))


def _possible(at: Tangent, offsets: Float[np.ndarray, "*faults nu"], level: float) -> Bool[np.ndarray, "*faults"]:
    """Which offsets are not lost in the noise, and not so large that the residual would be larger without them than with
    them: what is twice as long as the residual leaves more when it is undone."""
    sizes, residual = np.sqrt(np.vecdot(offsets, offsets)), float(np.linalg.norm(at.z))
    largest = 2 * max(residual, _LARGE_NOISE * level * float(np.sqrt(at.dof))) + FAR * level
    return (sizes > LEAST_SHIFT * level) & (sizes < largest)


def outlier(label: str, weights: tuple[float, float], block: np.ndarray | None, position: int) -> Cause:
    """The readings of one position (or one of them) in error by unknown amounts: undone by excluding the position."""
    own = (position,)
    return Cause(OUTLIER, label, *weights, block, positions=own, left_out=own, undone=partial(_without, own))


def _without(positions: tuple[int, ...], problem: Problem) -> Problem:
    return problem.without(positions)


def outliers(at: Tangent, level: float) -> CauseTable:
    """Candidates for each position: its three readings are in error by unknown amounts, or only that of one axis."""
    own, names, whole = at.responses.transpose(1, 2, 0), at.problem.names, at.whole_responses
    values, vectors = np.linalg.eigh(own @ own.mT)
    singular = np.sqrt(np.maximum(values, 0.0))
    sizes = np.sqrt(np.vecdot(own, own))
    # Of each position the directions of all three readings, then each reading by itself.
    seen = np.concatenate([singular > OUTLIER_VISIBLE * whole[:, :1], sizes > OUTLIER_VISIBLE * whole], axis=1)
    several = seen[:, :3].any(axis=1, keepdims=True)
    seen[:, 3:] &= several
    blocks = (vectors / np.maximum(singular, 1e-300)[:, None, :]).mT @ own
    rows = np.concatenate([blocks, own / np.maximum(sizes, 1e-300)[:, :, None]], axis=1)[seen]
    # The causes of each position: one of several readings, and one for each axis.
    position, kind = np.nonzero(np.concatenate([several, seen[:, 3:]], axis=1))
    owners = np.repeat(np.arange(len(kind)), np.where(kind > 0, 1, seen[:, :3].sum(axis=1)[position]))
    share = -float(np.log(2 * len(names)))
    together, alone = (log_weights("outlier_position", share - part) for part in (0.0, float(np.log(3))))
    weight, test_weight = (np.where(kind > 0, *each) for each in zip(alone, together, strict=True))
    position = position.tolist()

    def made(k: int, label: str, weights: tuple[float, float], block: np.ndarray) -> Cause:
        return outlier(label, weights, block, position[k])

    labels = [f"outlier_position:{names[k]}" for k in position]
    return CauseTable(OUTLIER, labels, weight, test_weight, rows, owners, made)


def swap(label: str, weights: tuple[float, float], offset: np.ndarray | None, pair: tuple[int, int]) -> Cause:
    """The readings of two positions exchanged: undone by exchanging them back."""
    return Cause(SWAP, label, *weights, offset=offset, positions=pair, undone=partial(_exchanged, pair))


def _exchanged(pair: tuple[int, int], problem: Problem) -> Problem:
    i, j = pair
    readings = np.array(problem.readings)
    readings[[i, j]] = readings[[j, i]]
    return replace(problem, readings=readings)


def swaps(at: Tangent, level: float) -> CauseTable | None:
    """One candidate for each pair of positions (of many positions: those that explain most) whose readings differ."""
    if at.model.hand_held:
        return None
    readings = at.problem.readings
    first, second, labels, of = exchanged_pairs(at, (LEAST_SHIFT * level) ** 2)
    change, offsets = readings[first] - readings[second], np.zeros((len(first), at.dof))
    for axis, of_axis in enumerate(at.responses.transpose(2, 1, 0)):
        part = of_axis[first]
        part -= of_axis[second]
        part *= change[:, axis, None]
        offsets += part
    possible = np.flatnonzero(_possible(at, offsets, level))
    weights = log_weights("swapped_positions", -float(np.log(max(1, of))))
    pairs = possible.tolist()

    def made(k: int, label: str, weights: tuple[float, float], offset: np.ndarray) -> Cause:
        return swap(label, weights, offset, (int(first[pairs[k]]), int(second[pairs[k]])))

    return equally_weighted(SWAP, [labels[pair] for pair in pairs], weights, offsets[possible], None, made)


def mislabel(
    label: str, weights: tuple[float, float], offset: np.ndarray | None, position: int, words: str, stood: Where
) -> Cause:
    """An angle of one position in error by a step of the plan: undone by the angle at which it was measured."""
    undone = partial(_with_angle, position, stood)
    return Cause(MISLABEL, label, *weights, offset=offset, positions=(position,), words=words, undone=undone)


def _with_angle(position: int, stood: Where, problem: Problem) -> Problem:
    def taken(old, new):
        changed = np.array(old)
        changed[position] = np.asarray(new)[position]
        return changed

    where = problem.where
    groups = {name: taken(index, stood.groups[name]) for name, index in where.groups.items()}
    moved = (taken(where.alpha, stood.alpha), taken(where.beta, stood.beta), groups)
    return replace(problem, where=eqx.tree_at(lambda w: (w.alpha, w.beta, w.groups), where, moved))


def mislabels(at: Tangent, level: float) -> CauseTable | None:
    """Candidates for each position and each step of the plan by which its angle may be in error."""
    if at.model.hand_held:
        return None
    names, predicted = at.problem.names, at.evaluation.predicted
    where = at.problem.where
    options = plan_steps(where)
    weights = log_weights("mislabelled_angle", -float(np.log(len(names) * max(1, len(options)))))
    changes = np.array([_predicted(at, step) - predicted for step in options]).reshape(-1, *predicted.shape)
    offsets = (changes.swapaxes(0, 1) @ at.responses.transpose(1, 2, 0)).swapaxes(0, 1)
    valid = np.array([step.valid for step in options], bool).reshape(offsets.shape[:2])
    step, position = np.nonzero(valid & _possible(at, offsets, level))
    offsets, step, position = offsets[step, position], step.tolist(), position.tolist()

    def made(k: int, label: str, weights: tuple[float, float], offset: np.ndarray) -> Cause:
        moved = options[step[k]]
        return mislabel(label, weights, offset, position[k], moved.words, moved.of(where))

    return equally_weighted(MISLABEL, [f"mislabelled_angle:{names[k]}" for k in position], weights, offsets, None, made)


def _predicted(at: Tangent, step: Step) -> Float[np.ndarray, "positions 3"]:
    """Prediction at a step's settings: those of other positions, where the plan has them all and nothing else decides it."""
    nominal = at.model.of_plan and not np.any(at.vector[at.model.layout.amplitudes])
    if nominal and step.twins is not None:
        return at.evaluation.predicted[step.twins]
    return at.model.predict(step.of(at.problem.where), at.vector)


FAULTS: tuple[Callable[[Tangent, float], CauseTable | None], ...] = (outliers, swaps, mislabels)
