"""Possible signs of the input of an effect that jumps, and the sum of squares that it explains with each choice."""

from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.model.tangent import Tangent
from tumblecal.diagnosis.tuning import LARGE


# Inputs may be off by this (g).
NEAR_ZERO = 0.1
# Of more positions of one setting the signs are not sought: there are as many choices as pairs of them.
_MOST_UNSURE = 40
# So many choices of the signs of several settings together.
_MOST_TOGETHER = 3000
# Of so many positions at fault each may be a jump's.
FEW_FAULTS = 3


def jump_explains(at: Tangent, members: Sequence[Cause], sigma: float) -> bool:
    """Whether an effect that jumps, with signs that small errors may cause, explains more than some causes around whose exact
    fit a problem is linearised. It is tried in addition to them, as one of them, or without another of them or without several
    positions at fault (then it must explain about as much): an input on the wrong side of zero looks like a fault."""
    nominal = at.jacobian[:, : at.model.nominal]
    for column in at.model.layout.jumping:
        others = [cause for cause in members if column not in cause.slot.columns]
        beside = [_rows_of(at, cause) for cause in others]
        inputs = at.evaluation.inputs[:, output_of(at, column)]
        here = np.sign(inputs) if len(others) < len(members) else np.zeros(len(inputs))
        signs = np.concatenate([here[None], sign_choices(at, column)])
        left = left_with(at, np.hstack([nominal, *beside]), column, signs)
        if left[0] - np.min(left) > LARGE * sigma**2:
            return True
        for without in _left_out(others):
            fewer = [rows for number, rows in enumerate(beside) if number not in without]
            if np.min(left_with(at, np.hstack([nominal, *fewer]), column, signs)) < left[0] + LARGE * sigma**2:
                return True
    return False


def _left_out(causes: Sequence[Cause]) -> list[tuple[int, ...]]:
    """Numbers of causes without which a jump may do: each of them, and positions at fault in whatever number, of many all."""
    faults = [k for k, cause in enumerate(causes) if cause.positions]
    sizes = range(2, len(faults) + 1) if len(faults) <= FEW_FAULTS else [len(faults)]
    return [(k,) for k in range(len(causes))] + [own for size in sizes for own in combinations(faults, size)]


def _rows_of(at: Tangent, cause: Cause) -> Float[np.ndarray, "rows coefficients"]:
    """White rows of a cause: of an effect by the directions of its coefficients that show and by its shape, of a fault all that
    its positions read."""
    if cause.positions:
        signals = np.zeros((len(at.evaluation.predicted), 3, 3 * len(cause.positions)))
        for number, position in enumerate(cause.positions):
            signals[position, :, 3 * number : 3 * number + 3] = np.eye(3)
        rows = at.problem.rows(signals)
        return np.concatenate([rows, np.zeros((len(at.residual) - len(rows), rows.shape[1]))])
    own = at.jacobian[:, list(cause.slot.columns)]
    shown = own if cause.directions is None else own @ cause.directions
    return np.hstack([shown, at.jacobian[:, list(cause.slot.shape)]])


def sign_choices(there: Tangent, column: int) -> Float[np.ndarray, "choices positions"]:
    """The signs of the input of an effect that jumps: as they are, and as small errors of the pitch and the mount may make them
    at one pitch setting, and at as many together as there are not too many choices of."""
    where, inputs = there.problem.where, there.evaluation.inputs[:, output_of(there, column)]
    signs, settings = np.sign(inputs)[None], np.round(where.pitch_angle, 6)
    separate = [signs]
    for setting in np.unique(settings):
        unsure = np.flatnonzero((settings == setting) & (np.abs(inputs) < NEAR_ZERO))
        if not 0 < len(unsure) <= _MOST_UNSURE:
            continue
        unsure = unsure[np.argsort(np.asarray(where.alpha)[unsure], kind="stable")]
        arcs = _arcs(len(unsure))
        separate.append(np.repeat(signs[:1], len(arcs), axis=0))
        separate[-1][:, unsure] = arcs
        if len(signs) * len(arcs) <= _MOST_TOGETHER:
            signs = np.repeat(signs, len(arcs), axis=0)
            signs[:, unsure] = np.tile(arcs, (len(signs) // len(arcs), 1))
    listed = np.concatenate([signs, *separate])
    # Compared as bytes: a tenth of the time.
    _, first = np.unique((listed + 1).astype(np.uint8).view(f"V{listed.shape[1]}").ravel(), return_index=True)
    return listed[first]


def left_with(
    there: Tangent,
    others: Float[np.ndarray, "rows others"],
    column: int,
    signs: Float[np.ndarray, "choices positions"],
) -> Float[np.ndarray, " choices"]:
    """The sum of squares that other white rows and an effect that jumps leave, with each of these signs."""
    signals = jump_signals(there, column, signs)
    basis, _ = np.linalg.qr(others)
    residual = there.residual - basis @ (basis.T @ there.residual)
    apart = signals - basis @ (basis.T @ signals)
    sizes = np.maximum(np.sum(apart**2, axis=0), 1e-12 * np.sum(signals**2, axis=0))
    return residual @ residual - (apart.T @ residual) ** 2 / np.maximum(sizes, 1e-300)


def jump_signals(
    there: Tangent, column: int, signs: Float[np.ndarray, "choices positions"]
) -> Float[np.ndarray, "rows choices"]:
    """White rows of an effect that jumps, by its scaled coefficient, with these signs."""
    raw, own = there.evaluation.jacobian, output_of(there, column)
    signals = np.zeros((*raw.shape[:2], len(signs)))
    signals[:, own] = np.max(np.abs(raw[:, own, column])) * signs.T
    rows = there.problem.rows(signals)
    return np.concatenate([rows, np.zeros((len(there.residual) - len(rows), len(signs)))])


def output_of(there: Tangent, column: int) -> int:
    """The output on which an effect acts."""
    return int(np.argmax(np.sum(np.abs(there.evaluation.jacobian[:, :, column]), axis=0)))


@lru_cache(maxsize=16)
def _arcs(count: int) -> Float[np.ndarray, "arcs count"]:
    """Signs of something that follows a single sine around so many angles in turn: one arc of minus, the rest plus."""
    first, number, length = np.ix_(range(count), range(count), range(count + 1))
    inside = (number - first) % count < length
    return np.unique(np.where(inside, -1.0, 1.0).swapaxes(1, 2).reshape(-1, count), axis=0)
