"""Variables of a field: the attitude, the inputs, the angles of the head, the temperature, the time.

Each is the covariance (kernel) of a Gaussian process over the positions: smooth over a stated correlation length, in steps,
bent at planes across gravity, or swinging in time (Rasmussen and Williams 2006, chapter 4). A process is represented by its
principal components.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg.lapack import dpstrf  # type: ignore[attr-defined]

from tumblecal.chain import Where
from tumblecal.diagnosis.priors import (
    ATTITUDE_LENGTH,
    COMPONENTS_PER_POSITION,
    HEAD_LENGTHS,
    INPUT_LENGTHS,
    MOST_COMPONENTS,
    OMITTED_VARIANCE,
    PLANES,
    SPINDLE_LENGTHS,
    SWING_LENGTH,
    SWINGS,
    TEMPERATURE_LENGTH,
    TIME_LENGTHS,
    WANDERING_SHARE,
)
from tumblecal.effects import AXES


# A share of the largest variance that is no more than rounding.
_ROUNDING = 1e-13


class Variable(NamedTuple):
    """The variable of a field: words, the kind of variable, principal components of a process over it, and its prior share
    among the variables."""

    words: str
    kind: str
    components: Float[np.ndarray, "positions components"]
    share: float


def variables(inputs: Float[np.ndarray, "positions 3"], where: Where) -> list[Variable]:
    """All variables of some positions with these inputs."""

    def of(column: object) -> tuple[float, ...] | None:
        return None if column is None else tuple(np.asarray(column, float).tolist())

    pitch, order = np.asarray(where.index("pitch")), tuple(where.measuring_order.tolist())
    of_plan = _of_plan(order, tuple(pitch.tolist()), of(where.alpha), of(where.beta), of(where.approach))
    return [*of_plan, *_of_readings(inputs, order, of(where.temperature_degc))]


@lru_cache(maxsize=64)
def _of_plan(
    order: tuple[float, ...],
    pitch: tuple[int, ...],
    alpha: tuple[float, ...],
    beta: tuple[float, ...],
    approach: tuple[float, ...] | None,
) -> list[Variable]:
    """Those that the plan decides: the time, smooth, in steps (a random walk whose level is unknown) and in swings whose phase
    wanders smoothly; the time since the pitch was changed; the head's angles, and the spindle's alone; the head's angles with
    the sign of the side from which a position was approached."""
    time = _shares(np.array(order))
    listed = [
        _variable("the time, quickly changing", "smooth", _smooth(time / TIME_LENGTHS[0])),
        _variable("the time, slowly changing", "smooth", _smooth(time / TIME_LENGTHS[1])),
        _variable("the time, in steps", "wandering", 1.0 - np.abs(time - time.T), WANDERING_SHARE),
    ]
    if len(set(pitch)) > 1:
        since = _shares(_since_change(time[:, 0], np.array(pitch)))
        kernel = _smooth(since / TIME_LENGTHS[1])
        listed.append(_variable("the time since the pitch was changed", "smooth", kernel))
    for count in (count for count in SWINGS if 2 * count < len(time) - 1):
        kernel = _smooth(time / SWING_LENGTH) * np.cos(2 * np.pi * count * (time - time.T))
        listed.append(_variable(f"the time, in some {count} swings", "swing", kernel, WANDERING_SHARE))
    spindle = np.stack([np.cos(alpha), np.sin(alpha)], axis=1)
    head = np.column_stack([spindle, beta])
    for words, kind, angles, lengths in (
        ("the head's angles", "head", head, HEAD_LENGTHS),
        ("the spindle angle", "spindle", spindle, SPINDLE_LENGTHS),
    ):
        listed += [_variable(f"{words}{end}", kind, _smooth(angles / length)) for end, length in lengths.items()]
    if approach is not None and np.ptp(approach) > 0:
        kernel = np.outer(approach, approach) * _smooth(head / HEAD_LENGTHS[", slowly bending"])
        listed.append(_variable("the head's angles, opposite from the two sides", "head", kernel))
    return listed


def _of_readings(
    inputs: Float[np.ndarray, "positions 3"], order: tuple[float, ...], degc: tuple[float, ...] | None
) -> list[Variable]:
    """Those that depend on the readings: the attitude; the attitude and what changes slowly; the side to which gravity pulls;
    what is touched on one side; the inputs; the temperature."""
    gravity = inputs / np.sqrt(np.vecdot(inputs, inputs))[:, None]
    of_gravity = _smooth(gravity / ATTITUDE_LENGTH)
    slowly = {"the time": _smooth(_shares(np.array(order)) / TIME_LENGTHS[1])}
    if degc is not None and np.ptp(degc) > 0:
        slowly["the temperature"] = _smooth(_shares(np.array(degc)) / TEMPERATURE_LENGTH)
    # Kernels of what falls to one side or the other, and of what is touched on one side alone: sums of steps, and of ramps
    # that begin, at planes across the direction of gravity (arc-cosine kernels of order 0 and 1, Cho and Saul 2009).
    extended = np.column_stack([gravity, np.full(len(gravity), PLANES)])
    cosine = np.clip(extended @ extended.T / (1.0 + PLANES**2), -1.0, 1.0)
    angle = np.arccos(cosine)
    listed = [
        ("the attitude", "attitude", of_gravity),
        *((f"the attitude and {words}", "changing", of_gravity * kernel) for words, kernel in slowly.items()),
        ("the side to which gravity pulls", "side", 1.0 - angle / np.pi),
        ("the lean to one side", "lean", (np.sqrt(1.0 - cosine**2) + (np.pi - angle) * cosine) / np.pi),
        *((words, "smooth", kernel) for words, kernel in slowly.items() if words != "the time"),
    ]
    for axis, values in zip(AXES, inputs.T, strict=True):
        for bending, length in INPUT_LENGTHS.items():
            words = f"input {axis}{bending}"
            listed.append((words, words if not bending else "quick input", _smooth(values[:, None] / length)))
    return [_variable(*own) for own in listed]


def _since_change(time: Float[np.ndarray, " positions"], setting: Int[np.ndarray, " positions"]) -> np.ndarray:
    """The time since the pitch was changed."""
    turn = np.argsort(time, kind="stable")
    changed, ordered, since = np.concatenate([[True], np.diff(setting[turn]) != 0]), time[turn], np.zeros(len(time))
    since[turn] = ordered - ordered[changed][np.cumsum(changed) - 1]
    return since


def _shares(values: Float[np.ndarray, " positions"]) -> Float[np.ndarray, "positions 1"]:
    """The time, or the temperature, as shares of the whole."""
    return ((values - values.min()) / max(np.ptp(values), 1e-12))[:, None]


def _smooth(values: Float[np.ndarray, "positions variables"]) -> Float[np.ndarray, "positions positions"]:
    """A Gaussian kernel of length one."""
    difference = values[:, None] - values
    return np.exp(-0.5 * np.vecdot(difference, difference))


def _variable(words: str, kind: str, kernel: Float[np.ndarray, "positions positions"], share: float = 1.0) -> Variable:
    """The variable of a kernel, with the principal components that carry nearly all of it.

    Most kernels have a low rank: a Cholesky factorisation with pivots finds it (Golub and Van Loan 2013, section 4.2.8), and
    the components are turned columns of the factor.
    """
    triangle, pivots, rank, _ = dpstrf(kernel, lower=1, tol=_ROUNDING * float(np.max(np.diag(kernel))))
    factor = np.empty((len(kernel), rank))
    factor[pivots - 1] = np.tril(triangle)[:, :rank]
    variances, turn = np.linalg.eigh(factor.T @ factor)
    carried = np.cumsum(np.maximum(variances[::-1], 0.0))
    count = int(np.sum(carried < (1 - OMITTED_VARIANCE) * carried[-1])) + 1
    count = min(count, MOST_COMPONENTS, int(COMPONENTS_PER_POSITION * len(kernel)))
    return Variable(words, kind, factor @ turn[:, ::-1][:, :count], share)
