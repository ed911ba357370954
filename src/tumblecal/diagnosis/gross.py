"""Faults of the procedure as exact alternatives: one position off, two exchanged, an angle off by a step."""

from collections.abc import Sequence
from itertools import combinations

import equinox as eqx
import numpy as np

from tumblecal.chain import Where
from tumblecal.diagnosis.candidates import Candidate
from tumblecal.diagnosis.linear import Linear, Weighting
from tumblecal.diagnosis.model import Model


# Exchanged readings closer than this (weighted norm) cannot be told from correct ones.
LEAST_SHIFT = 3.0
MOST_PAIRS = 5000
# A direction of an outlying reading counts when the fit leaves more than this share of it.
OUTLIER_VISIBLE = 0.1


def outliers(linear: Linear, how: Weighting, names: Sequence[str]) -> list[Candidate]:
    """Candidates for each position: its three readings are off by unknown amounts, or that of one axis alone."""
    count = len(names)
    unit = np.zeros((count, 3, count * 3))
    unit[np.repeat(np.arange(count), 3), np.tile(np.arange(3), count), np.arange(count * 3)] = 1.0
    rows = how.rows(unit)
    rows = np.vstack([rows, np.zeros((linear.basis.shape[0] - len(rows), count * 3))])
    projected = linear.basis.T @ rows
    found = []
    for position in range(count):
        label, columns = f"outlier_position:{names[position]}", slice(3 * position, 3 * position + 3)
        left, singular, _ = np.linalg.svd(projected[:, columns], full_matrices=False)
        seen = singular > OUTLIER_VISIBLE * np.linalg.norm(rows[:, 3 * position])
        if not np.any(seen):
            continue
        weight = -np.log(2 * count)
        found.append(Candidate("outlier", label, weight, block=left[:, seen], positions=(position,)))
        for axis in range(3):
            column = projected[:, [3 * position + axis]]
            size = np.linalg.norm(column)
            if size > OUTLIER_VISIBLE * np.linalg.norm(rows[:, 3 * position + axis]):
                one_axis = weight - np.log(3)
                found.append(Candidate("outlier", label, one_axis, block=column / size, positions=(position,)))
    return found


def swaps(
    linear: Linear, how: Weighting, readings: np.ndarray, where: Where, names: Sequence[str], noise: float
) -> list[Candidate]:
    """One candidate for each pair of positions (of one run, where there are too many) whose readings differ."""
    run = np.asarray(where.index("run"))
    pairs = list(combinations(range(len(names)), 2))
    if len(pairs) > MOST_PAIRS:
        pairs = [(i, j) for i, j in pairs if run[i] == run[j] and j - i <= MOST_PAIRS // len(names)]
    shift = np.zeros((len(names), 3, len(pairs)))
    for number, (i, j) in enumerate(pairs):
        shift[i, :, number] = readings[i] - readings[j]
        shift[j, :, number] = readings[j] - readings[i]
    offsets = _projected(linear, how, shift)
    far = np.linalg.norm(offsets, axis=0) > LEAST_SHIFT * noise
    return [
        Candidate(
            "swap",
            f"swapped_positions:{names[i]}+{names[j]}",
            -np.log(max(1, len(pairs))),
            offset=offsets[:, number],
            positions=(i, j),
        )
        for number, (i, j) in enumerate(pairs)
        if far[number]
    ]


def mislabels(
    model: Model, linear: Linear, how: Weighting, where: Where, names: Sequence[str], noise: float
) -> list[Candidate]:
    """One candidate for each position and each step of the plan that its angle may be off by."""
    found, predicted = [], linear.evaluation.predicted
    options = steps(where)
    for words, other, valid in options:
        change = model.evaluate(other, linear.vector).predicted - predicted
        shift = np.zeros((len(names), 3, len(names)))
        shift[np.arange(len(names)), :, np.arange(len(names))] = change
        offsets = _projected(linear, how, shift)
        far = valid & (np.linalg.norm(offsets, axis=0) > LEAST_SHIFT * noise)
        found += [
            Candidate(
                "mislabel",
                f"mislabelled_angle:{names[int(position)]}",
                -np.log(len(names) * len(options)),
                offset=offsets[:, position],
                positions=(int(position),),
                words=words,
            )
            for position in np.flatnonzero(far)
        ]
    return found


def steps(where: Where) -> list[tuple[str, Where, np.ndarray]]:
    """The plan with every position moved by one step: words, settings, and for which positions that step exists."""
    alpha, beta = np.asarray(where.alpha), np.asarray(where.beta)
    turns = np.unique(np.round(alpha, 9))
    place = np.searchsorted(turns, np.round(alpha, 9))
    options = []
    if len(turns) > 1:
        for sign, words in ((1, "next"), (-1, "previous")):
            moved = turns[(place + sign) % len(turns)]
            options.append(
                (f"{words} spindle angle", eqx.tree_at(lambda w: w.alpha, where, moved), np.ones(len(alpha), bool))
            )
    levels = np.unique(np.round(beta, 9))
    level = np.searchsorted(levels, np.round(beta, 9))
    same = list(zip(np.asarray(where.index("run")), np.asarray(where.index("mount")), strict=True))
    for sign, words in ((1, "next"), (-1, "previous")):
        source = np.arange(len(beta))
        for position in range(len(beta)):
            target = level[position] + sign
            twins = [k for k in range(len(beta)) if level[k] == target and same[k] == same[position]]
            source[position] = twins[0] if twins else position
        valid = source != np.arange(len(beta))
        if np.any(valid):
            groups = {
                name: np.asarray(index)[source] if "pitch" in name else np.asarray(index)
                for name, index in where.groups.items()
            }
            moved = eqx.tree_at(lambda w: (w.beta, w.groups), where, (beta[source], groups))
            options.append((f"{words} pitch setting", moved, valid))
    return options


def _projected(linear: Linear, how: Weighting, shift: np.ndarray) -> np.ndarray:
    rows = how.rows(shift)
    return linear.basis[: len(rows)].T @ rows
