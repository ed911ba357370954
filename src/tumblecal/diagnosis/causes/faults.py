"""Faults of the procedure: an outlier position, exchanged positions, an angle in error by a step, readings that ended at the
range of their axis. Their descriptions are in the catalogue (effects/procedure.py).

Undoing an exchange subtracts its contribution from the residual z of the nominal model: with the responses R of single readings
and the difference c of the two readings, the offset is o = sum over the axes of c_a (R_ia - R_ja).
"""

from dataclasses import replace
from functools import partial
from math import comb

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.chain import Where
from tumblecal.diagnosis.causes.cause import Cause, Kind
from tumblecal.diagnosis.causes.table import Pool
from tumblecal.diagnosis.priors import (
    FAR,
    FAULT_TEST_WEIGHTS,
    FAULT_WEIGHTS,
    LEAST_SHIFT,
    MOST_EXCHANGED,
    OTHER_FAULT_TEST_WEIGHT,
    OTHER_FAULT_WEIGHT,
    OUTLIER_VISIBLE,
)
from tumblecal.effects import AXES
from tumblecal.estimation.problem import Problem
from tumblecal.estimation.setup.unmeasured import equal_ends
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.angle_settings import setting_angle, setting_index


# Noise of this many times its level is drawn in none of the tests.
_LARGE_NOISE = 1.5
# Of readings whose numbers are coarse, equal ones are no evidence.
_LEAST_CHANCE = 0.05


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


def outlier(position: int, cause: Cause) -> Cause:
    """The readings of one position (or one of them) in error by unknown amounts: undone by excluding the position."""
    own = (position,)
    return cause._replace(positions=own, left_out=own, undone=partial(_without, own))


def _without(positions: tuple[int, ...], problem: Problem) -> Problem:
    return problem.without(positions)


def outliers(at: Tangent) -> Pool:
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
    # The candidates of each position: one of several readings, and one for each axis.
    position, kind = np.nonzero(np.concatenate([several, seen[:, 3:]], axis=1))
    owners = np.repeat(np.arange(len(kind)), np.where(kind > 0, 1, seen[:, :3].sum(axis=1)[position]))
    logs = np.array(log_weights("outlier_position", -float(np.log(2 * len(names)))))[:, None]
    weights, positions = tuple(logs - np.where(kind > 0, np.log(3), 0.0)), position.tolist()

    def made(k: int, cause: Cause) -> Cause:
        return outlier(positions[k], cause)

    return Pool.of_kind(
        Kind.OUTLIER, [f"outlier_position:{names[k]}" for k in positions], (weights[0], weights[1]), rows, owners, made
    )


def swap(pair: tuple[int, int], cause: Cause) -> Cause:
    """The readings of two positions exchanged: undone by exchanging them back."""
    return cause._replace(positions=pair, undone=partial(_exchanged, pair))


def _exchanged(pair: tuple[int, int], problem: Problem) -> Problem:
    i, j = pair
    readings = np.array(problem.readings)
    readings[[i, j]] = readings[[j, i]]
    return replace(problem, readings=readings)


def swaps(at: Tangent, level: float) -> Pool:
    """One candidate for each pair of positions whose readings differ; of many positions of those that the residual contradicts
    most: an exchange that shows at all is seen at both."""
    readings, names = np.asarray(at.problem.readings), at.problem.names
    responses = at.responses.transpose(1, 2, 0)
    along = responses @ at.z
    suspect = np.sort(np.argsort(-np.vecdot(along, along), kind="stable")[:MOST_EXCHANGED])
    first, second = (suspect[own] for own in np.triu_indices(len(suspect), 1))
    change, offsets = readings[first] - readings[second], np.zeros((len(first), at.dof))
    for axis in range(3):
        offsets += (responses[first, axis] - responses[second, axis]) * change[:, axis, None]
    possible = np.flatnonzero(_possible(at, offsets, level))
    pairs = list(zip(first[possible].tolist(), second[possible].tolist(), strict=True))

    def made(k: int, cause: Cause) -> Cause:
        return swap(pairs[k], cause)

    labels = [f"swapped_positions:{names[i]}+{names[j]}" for i, j in pairs]
    weights = log_weights("swapped_positions", -float(np.log(max(1, comb(len(names), 2)))))
    return Pool.of_kind(Kind.SWAP, labels, weights, offsets[possible], None, made)


def mislabel(position: int, words: str, measured: Where, cause: Cause) -> Cause:
    """An angle of one position in error by a step of the plan: undone by the angle at which it was measured."""
    return cause._replace(positions=(position,), words=words, undone=partial(_with_angle, position, measured))


def _with_angle(position: int, measured: Where, problem: Problem) -> Problem:
    def taken(old, new):
        changed = np.array(old)
        changed[position] = np.asarray(new)[position]
        return changed

    where = problem.where
    groups = {name: taken(index, measured.groups[name]) for name, index in where.groups.items()}
    moved = (taken(where.alpha, measured.alpha), taken(where.beta, measured.beta), groups)
    return replace(problem, where=eqx.tree_at(lambda w: (w.alpha, w.beta, w.groups), where, moved))


def plan_steps(where: Where) -> list[tuple[str, Where, Bool[np.ndarray, " positions"]]]:
    """The settings with every position moved to the next or the previous spindle angle or pitch setting of the plan: in words,
    moved, and for which positions that step exists."""
    alpha, same = np.asarray(where.alpha), np.arange(len(np.asarray(where.alpha)))
    level, run, mount = (np.asarray(where.index(name)) for name in ("pitch", "run", "mount"))
    turn = setting_index(alpha, held=False)
    turns = np.round(setting_angle(alpha, turn)[np.unique(turn, return_index=True)[1]], 9)
    together, steps = (run[:, None] == run) & (mount[:, None] == mount), []

    def moved(to: np.ndarray, source: Int[np.ndarray, " positions"]) -> Where:
        index = {
            name: np.asarray(own)[source] if "pitch" in name else np.asarray(own) for name, own in where.groups.items()
        }
        return replace(where, alpha=to, beta=np.asarray(where.beta)[source], groups=index)

    ways = ((1, "next"), (-1, "previous"))
    if len(turns) > 1:
        everywhere = np.ones(len(alpha), bool)
        steps += [
            (f"{way} spindle angle", moved(turns[(turn + sign) % len(turns)], same), everywhere) for sign, way in ways
        ]
    for sign, way in ways:
        # The first position of the same run and mounting at the next level.
        twins = together & (level == level[:, None] + sign)
        valid = np.any(twins, axis=1)
        if np.any(valid):
            steps.append((f"{way} pitch setting", moved(alpha, np.where(valid, np.argmax(twins, axis=1), same)), valid))
    return steps


def mislabels(at: Tangent, level: float) -> Pool:
    """Candidates for each position and each step of the plan by which its angle may be in error."""
    names, predicted, steps = at.problem.names, at.evaluation.predicted, plan_steps(at.problem.where)
    weights = log_weights("mislabelled_angle", -float(np.log(len(names) * max(1, len(steps)))))
    changes = np.array([at.model.predict(moved, at.vector) - predicted for _, moved, _ in steps])
    changes = changes.reshape(-1, *predicted.shape)
    offsets = (changes.swapaxes(0, 1) @ at.responses.transpose(1, 2, 0)).swapaxes(0, 1)
    valid = np.array([valid for *_, valid in steps], bool).reshape(offsets.shape[:2])
    step, position = np.nonzero(valid & _possible(at, offsets, level))
    offsets, step, position = offsets[step, position], step.tolist(), position.tolist()

    def made(k: int, cause: Cause) -> Cause:
        words, moved, _ = steps[step[k]]
        return mislabel(position[k], words, moved, cause)

    labels = [f"mislabelled_angle:{names[k]}" for k in position]
    return Pool.of_kind(Kind.MISLABEL, labels, weights, offsets, None, made)


def clipped(at: Tangent) -> list[Pool]:
    """A candidate for each axis with readings that ended at its range, where the residuals can show them: as many coefficients
    as readings that are equal there to the last digit. It has no part in the test: of plans alone nobody knows of them."""
    weight, _ = log_weights("clipping", -float(np.log(len(AXES))))
    pools = dict[int, Pool]()
    for end in equal_ends(np.asarray(at.problem.readings)):
        left, singular, right = np.linalg.svd(at.responses[:, end.rows, end.axis], full_matrices=False)
        shown = singular > OUTLIER_VISIBLE * np.max(at.whole_responses[end.rows, end.axis])
        if end.axis in pools or end.chance > _LEAST_CHANCE or not np.any(shown):
            continue
        signals = np.zeros((*at.problem.readings.shape, int(np.sum(shown))))
        signals[end.rows, end.axis] = right[shown].T
        terms = tuple(at.problem.rows(signals).T.copy())
        names = ", ".join(at.problem.names[row] for row in end.rows.tolist())
        words = f"{end.size:.9g} g at positions {names}"

        def made(k: int, cause: Cause, terms: tuple[np.ndarray, ...] = terms, words: str = words) -> Cause:
            return cause._replace(terms=terms, words=words)

        label, owners = f"clipping.{AXES[end.axis]}", np.zeros(len(terms), int)
        pools[end.axis] = Pool.of_kind(Kind.CLIPPED, [label], (weight, -np.inf), left[:, shown].T, owners, made)
    return list(pools.values())
