"""Variants of an effect that jumps with the sign of its input: one for each choice of the signs of inputs near zero.

The nominal parameters absorb a part of every effect. They move by it, and inputs near zero change their sign: at the nominal
fit the effect has another signal than at the true parameters. Each choice of signs that small errors of the pitch and the
mount can cause is a variant with a row of its own; the exact fit with a variant begins where the inputs have its signs.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes.cause import SIGNS, Cause
from tumblecal.diagnosis.causes.table import Pool
from tumblecal.full_model.priors import EFFECT_WEIGHT, VISIBLE
from tumblecal.full_model.tangent import Tangent
from tumblecal.full_model.visibility import least_signal


# Inputs nearer to zero (g) have either sign.
NEAR_ZERO = 0.1
# The signs of more positions of one setting are not varied; choices of several settings together are, up to this number.
_MOST_UNSURE, _MOST_TOGETHER = 40, 3000
# An input with a fixed sign is at this distance (g) from zero, pulled there by this weight (1/g).
_FROM_ZERO, _HELD = 1e-6, 1e8
# Step of finite differences, in scaled parameters.
_STEP = 1e-3


def sign_variants(at: Tangent) -> list[Pool]:
    """The variants of every effect that jumps, as candidates with the effect's label; none where no input is near zero."""
    layout, pools = at.model.layout, list[Pool]()
    numbers = np.flatnonzero(layout.kinked)
    for number, share in zip(numbers.tolist(), layout.log_shares(np.arange(len(layout.slots)))[numbers], strict=True):
        slot = layout.slots[number]
        signs = sign_choices(at, slot.columns[0])
        whole = jump_signals(at, slot.columns[0], signs)
        rows = whole.T @ at.basis
        sizes = np.linalg.norm(rows, axis=1)
        shown = sizes > np.maximum(VISIBLE * np.linalg.norm(whole, axis=0), least_signal(at))
        signs, rows = signs[shown], rows[shown] / sizes[shown, None]

        def made(k: int, cause: Cause, signs: np.ndarray = signs) -> Cause:
            return cause._replace(directions=np.eye(1), signs=signs[k])

        weights, slots = (share + np.log(EFFECT_WEIGHT), -np.inf), [slot] * len(rows)
        pools.append(Pool.of_kind(SIGNS, [slot.id] * len(rows), weights, rows, None, made, slots))
    return pools


def sign_choices(at: Tangent, column: int) -> Float[np.ndarray, "choices positions"]:
    """The signs of the input of an effect that jumps, other than those where the problem is linearised: as small errors of
    the pitch and the mount can make them at one setting, and at several together where the choices are not too many."""
    where, inputs = at.problem.where, at.evaluation.inputs[:, output_of(at, column)]
    signs, settings = np.sign(inputs)[None], np.round(where.pitch_angle, 6)
    separate = [signs]
    for setting in np.unique(settings):
        unsure = np.flatnonzero((settings == setting) & (np.abs(inputs) < NEAR_ZERO))
        if not 0 < len(unsure) <= _MOST_UNSURE:
            continue
        unsure = unsure[np.argsort(np.asarray(where.alpha)[unsure], kind="stable")]
        # Signs of a sine with an offset at these angles in turn: one arc of minus, the rest plus.
        count = len(unsure)
        start, number, length = np.ix_(range(count), range(count), range(count + 1))
        inside = (number - start) % count < length
        arcs = np.unique(np.where(inside, -1.0, 1.0).swapaxes(1, 2).reshape(-1, count), axis=0)
        separate.append(np.repeat(signs[:1], len(arcs), axis=0))
        separate[-1][:, unsure] = arcs
        if len(signs) * len(arcs) <= _MOST_TOGETHER:
            signs = np.repeat(signs, len(arcs), axis=0)
            signs[:, unsure] = np.tile(arcs, (len(signs) // len(arcs), 1))
    listed = np.concatenate([signs, *separate])
    # Compared as bytes: a tenth of the time.
    _, first = np.unique((listed + 1).astype(np.uint8).view(f"V{listed.shape[1]}").ravel(), return_index=True)
    return listed[first][np.any(listed[first] != np.sign(inputs), axis=1)]


def jump_signals(
    at: Tangent, column: int, signs: Float[np.ndarray, "choices positions"]
) -> Float[np.ndarray, "rows choices"]:
    """White rows of an effect that jumps, by its scaled coefficient, with these signs."""
    raw, output = at.evaluation.jacobian, output_of(at, column)
    signals = np.zeros((*raw.shape[:2], len(signs)))
    signals[:, output] = np.max(np.abs(raw[:, output, column])) * signs.T
    rows = at.problem.rows(signals)
    return np.concatenate([rows, np.zeros((len(at.residual) - len(rows), len(signs)))])


def output_of(at: Tangent, column: int) -> int:
    """The output on which an effect acts."""
    return int(np.argmax(np.sum(np.abs(at.evaluation.jacobian[:, :, column]), axis=0)))


def start_with_signs(
    at: Tangent, causes: Sequence[Cause], directions: Float[np.ndarray, "full moved"]
) -> Float[np.ndarray, " full"]:
    """Full vector of the linear solution with some causes in which the inputs have the signs of their variants.

    **Arguments:**

    - `at`: the linearised problem, its faults undone. `directions`: the moved directions of the scaled full vector.
    """
    model, rows = at.model, at.jacobian @ directions
    wanted, turned = [], []
    for cause in causes:
        if cause.signs is not None:
            output, column = output_of(at, cause.slot.columns[0]), cause.slot.columns[0]
            moved = int(np.argmax(np.abs(directions[column])))
            rows[:, moved] = jump_signals(at, column, cause.signs[None])[:, 0] * directions[column, moved]
            wanted.append((cause.signs, at.evaluation.inputs[:, output]))
            turned.append(output)
    # Change of the inputs (g) for a step along each direction, by finite differences.
    near = at.vector + _STEP * at.model.scales * directions.T
    changes = [(at.model.inputs(at.problem.where, own) - at.evaluation.inputs) / _STEP for own in near]
    slopes = np.stack(changes, axis=2)[:, turned]
    slopes = slopes.transpose(1, 0, 2).reshape(-1, directions.shape[1])
    signs, inputs = (np.concatenate(each) for each in zip(*wanted, strict=True))
    held = np.zeros(len(signs), bool)
    takes_part = np.ones(len(rows))
    takes_part[: at.problem.readings.size] = np.repeat(at.problem.takes_part, 3)
    while True:
        pulled = np.concatenate([rows * takes_part[:, None], _HELD * slopes[held]])
        aim = np.concatenate([at.residual * takes_part, _HELD * (signs * _FROM_ZERO - inputs)[held]])
        step, *_ = np.linalg.lstsq(pulled, aim, rcond=1e-12)
        astray = ~held & (signs * (inputs + slopes @ step) < 0)
        if not np.any(astray):
            vector = model.with_nominal(at.vector[: model.nominal])
            return vector + model.scales * (directions @ step)
        held |= astray
