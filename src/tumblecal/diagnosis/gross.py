"""Faults of the procedure as exact alternatives: one position off, two exchanged, an angle off by a step."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Where
from tumblecal.diagnosis.candidates import Candidate
from tumblecal.diagnosis.linear import Linear, Weighting
from tumblecal.diagnosis.model import Model


# Exchanged readings closer than this (weighted norm) cannot be told from correct ones.
LEAST_SHIFT = 3.0
MOST_PAIRS = 5000
# A direction of an outlying reading counts when the fit leaves more than this share of it.
OUTLIER_VISIBLE = 0.1


def responses(linear: Linear, how: Weighting, count: int) -> Float[np.ndarray, "nu positions 3"]:
    """What a unit change of every single reading does in the residual space."""
    rows = linear.basis[: 3 * count]
    if how.whiten is not None:
        rows = how.whiten.T @ rows
    return (rows * how.weights.reshape(-1, 1)).T.reshape(-1, count, 3)


def outliers(each: Float[np.ndarray, "nu positions 3"], how: Weighting, names: Sequence[str]) -> list[Candidate]:
    """Candidates for each position: its three readings are off by unknown amounts, or that of one axis alone."""
    own = np.ascontiguousarray(np.swapaxes(each, 0, 1))
    values, vectors = np.linalg.eigh(np.swapaxes(own, 1, 2) @ own)
    singular = np.sqrt(np.maximum(values, 0.0))
    blocks = own @ (vectors / np.maximum(singular, 1e-300)[:, None, :])
    sizes = np.linalg.norm(each, axis=0)
    units = each / np.maximum(sizes, 1e-300)
    weight, one_axis = -np.log(2 * len(names)), -np.log(2 * len(names)) - np.log(3)
    whole = _whole(how)
    found = []
    for position, name in enumerate(names):
        label, seen = f"outlier_position:{name}", singular[position] > OUTLIER_VISIBLE * whole[position, 0]
        if not np.any(seen):
            continue
        found.append(Candidate("outlier", label, weight, block=blocks[position][:, seen], positions=(position,)))
        found += [
            Candidate("outlier", label, one_axis, block=units[:, position, axis : axis + 1], positions=(position,))
            for axis in range(3)
            if sizes[position, axis] > OUTLIER_VISIBLE * whole[position, axis]
        ]
    return found


def _whole(how: Weighting) -> Float[np.ndarray, "positions 3"]:
    """Weighted size of a unit change of each reading."""
    if how.whiten is None:
        return how.weights
    return np.linalg.norm(how.whiten, axis=0).reshape(how.weights.shape) * how.weights


def swaps(
    each: Float[np.ndarray, "nu positions 3"],
    readings: Float[np.ndarray, "positions 3"],
    where: Where,
    names: Sequence[str],
    noise: float,
) -> list[Candidate]:
    """One candidate for each pair of positions (of one run, where there are too many) whose readings differ."""
    run = np.asarray(where.index("run"))
    first, second = np.triu_indices(len(names), 1)
    if len(first) > MOST_PAIRS:
        kept = (run[first] == run[second]) & (second - first <= MOST_PAIRS // len(names))
        first, second = first[kept], second[kept]
    change = readings[first] - readings[second]
    offsets = np.zeros((each.shape[0], len(first)))
    for axis in range(3):
        offsets += (each[:, first, axis] - each[:, second, axis]) * change[:, axis]
    far = np.flatnonzero(np.linalg.norm(offsets, axis=0) > LEAST_SHIFT * noise)
    weight, kept_offsets = -np.log(max(1, len(first))), np.ascontiguousarray(offsets[:, far].T)
    pairs = zip(first[far].tolist(), second[far].tolist(), kept_offsets, strict=True)
    return [
        Candidate("swap", f"swapped_positions:{names[i]}+{names[j]}", weight, offset=offset, positions=(i, j))
        for i, j, offset in pairs
    ]


def mislabels(
    model: Model,
    linear: Linear,
    each: Float[np.ndarray, "nu positions 3"],
    where: Where,
    names: Sequence[str],
    noise: float,
) -> list[Candidate]:
    """Candidates for each position and each step of the plan that its angle may be off by."""
    found, predicted = [], linear.evaluation.predicted
    options = steps(where)
    weight = -np.log(len(names) * max(1, len(options)))
    for words, other, valid in options:
        change = model.predict(other, linear.vector) - predicted
        offsets = np.einsum("vpi,pi->pv", each, change)
        far = valid & (np.linalg.norm(offsets, axis=1) > LEAST_SHIFT * noise)
        found += [
            Candidate(
                "mislabel",
                f"mislabelled_angle:{names[position]}",
                weight,
                offset=offsets[position],
                positions=(position,),
                words=words,
            )
            for position in np.flatnonzero(far).tolist()
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
            options.append((f"{words} spindle angle", replace(where, alpha=moved), np.ones(len(alpha), bool)))
    levels = np.unique(np.round(beta, 9))
    level = np.searchsorted(levels, np.round(beta, 9))
    run, mount = np.asarray(where.index("run")), np.asarray(where.index("mount"))
    together = (run[:, None] == run) & (mount[:, None] == mount)
    for sign, words in ((1, "next"), (-1, "previous")):
        # The first position of the same run and mounting at the next level.
        twins = together & (level[None, :] == level[:, None] + sign)
        valid = np.any(twins, axis=1)
        source = np.where(valid, np.argmax(twins, axis=1), np.arange(len(beta)))
        if np.any(valid):
            groups = {
                name: np.asarray(index)[source] if "pitch" in name else np.asarray(index)
                for name, index in where.groups.items()
            }
            options.append((f"{words} pitch setting", replace(where, beta=beta[source], groups=groups), valid))
    return options
