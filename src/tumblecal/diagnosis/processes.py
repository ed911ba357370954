"""What something that no entry describes may follow: errors of every kind as Gaussian processes, whatever their curve.

Every field (an output, all outputs, the scale factors, an error of the head, a turn of the triad) is given a process over the
attitude, the inputs, the head's angles, or the time: smooth over a stated correlation length, in steps, bent at planes across
gravity, or swinging in time (Rasmussen and Williams 2006, chapter 4).
"""

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.generic_causes import HEAD_ANGLES
from tumblecal.diagnosis.shape_causes import products
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.effects import AXES


# Correlation lengths of the direction of gravity (rad), of an input (g), and of the time (shares of the whole).
_ATTITUDE, _INPUT, _TIMES = 0.5, 0.2, (0.05, 0.2)
# The same of the head's angles and of the spindle's, short and long: what bends little pays little for it. (Of the outputs
# what bends little is a polynomial, which the catalogue has.)
_HEAD, _SPINDLE = {"": 0.5, ", slowly bending": 1.2}, {"": 0.25, ", slowly bending": 0.7}
# Swings in time: how often in the whole, and over which share of it they keep their phase.
_SWINGS, _IN_PHASE = range(3, 12), 0.7
# The prior share, beside any other process, of each count of swings, of which neighbours are alike, and of steps in time, most
# of which are one jump that the catalogue has.
_SHARE = 1 / 3
# How far from the middle (sd, in g) planes lie at which something falls to another side.
_PLANES = 0.5
# Of a process the components that carry all but this share of it, at most so many, and so many for each position: with as
# many as positions it would be a scatter from one to the next.
_LEFT_OUT, _MOST_COMPONENTS, _FOR_EACH = 0.01, 32, 2 / 3


class Variable(NamedTuple):
    """What a field follows: principal components of a process over it, and its prior share beside other variables."""

    components: Float[np.ndarray, "positions components"]
    share: float = 1.0


class Process(NamedTuple):
    """Signals of `fields`, one or three that each follow the variable by a curve of their own."""

    words: str
    fields: Float[np.ndarray, "positions 3 fields"]
    variable: Variable

    @property
    def signals(self) -> Float[np.ndarray, "positions 3 columns"]:
        """Every field times every component of the variable, field after field."""
        return products(self.fields, self.variable.components)


def processes(at: Tangent) -> Iterator[Process]:
    """All processes for one problem."""
    where, inputs = at.problem.where, np.asarray(at.evaluation.inputs)
    probe = at.evaluation.jacobian[:, :, at.model.probe]
    smooth, wandering, swings = _of_time(tuple(where.measuring_order.tolist()))
    attitude, changing, sides, lean = _of_attitude(inputs, where.measuring_order)
    of_inputs = {
        f"input {axis}": Variable(_components(_smooth(inputs[:, k : k + 1] / _INPUT))) for k, axis in enumerate(AXES)
    }
    outputs = np.broadcast_to(np.eye(3), (len(inputs), 3, 3))
    for k, axis in enumerate(AXES):
        for words, variable in (attitude | changing | of_inputs | smooth | swings).items():
            yield Process(f"output {axis}: a function of {words}", outputs[:, :, k : k + 1], variable)
    for words, variable in (attitude | sides | lean | smooth | wandering).items():
        yield Process(f"the outputs: functions of {words}", outputs, variable)
    for words, variable in (smooth | wandering).items():
        yield Process(f"the scale factors: functions of {words}", inputs[:, :, None] * outputs, variable)
    if at.model.hand_held:
        # Unknown attitudes take up any turn.
        return
    head, spindle = _of_angles(tuple(np.asarray(where.alpha).tolist()), tuple(np.asarray(where.beta).tolist()))
    for k, name in enumerate(HEAD_ANGLES):
        for words, variable in (head | spindle | smooth | wandering).items():
            yield Process(f"{name}: a function of {words}", probe[:, :, k : k + 1], variable)
    for words, variable in (head | changing | sides | smooth | wandering).items():
        yield Process(f"a turn of the triad: a function of {words}", probe, variable)


# Variables by their words.
_Variables = dict[str, Variable]


@lru_cache(maxsize=64)
def _of_time(order: tuple[float, ...]) -> tuple[_Variables, _Variables, _Variables]:
    """Smooth changes in time, those in steps (the covariance of a random walk whose level is unknown), and swings."""
    time = _shares(np.array(order))
    smooth = {
        "the time, quickly changing": Variable(_components(_smooth(time / _TIMES[0]))),
        "the time, slowly changing": Variable(_components(_smooth(time / _TIMES[1]))),
    }
    apart, in_phase = time - time.T, _smooth(time / _IN_PHASE)
    swings = {
        f"the time, in some {count} swings": Variable(_components(in_phase * np.cos(2 * np.pi * count * apart)), _SHARE)
        for count in _SWINGS
        if 2 * count < len(time) - 1
    }
    steps = Variable(_components(1.0 - np.abs(apart)), _SHARE)
    return smooth, {"the time, in steps": steps}, swings


def _of_attitude(
    inputs: Float[np.ndarray, "positions 3"], order: Float[np.ndarray, " positions"]
) -> tuple[_Variables, _Variables, _Variables, _Variables]:
    """The attitude; the attitude and the time; the side to which gravity pulls; what is touched on one side alone."""
    gravity = inputs / np.linalg.norm(inputs, axis=1, keepdims=True)
    slowly = _smooth(_shares(order) / _TIMES[1])
    of_gravity, (steps, ramps) = _smooth(gravity / _ATTITUDE), _sides(gravity)
    return (
        {"the attitude": Variable(_components(of_gravity))},
        {"the attitude and the time": Variable(_components(of_gravity * slowly))},
        {"the side to which gravity pulls": Variable(_components(steps))},
        {"the lean to one side": Variable(_components(ramps))},
    )


@lru_cache(maxsize=64)
def _of_angles(alpha: tuple[float, ...], beta: tuple[float, ...]) -> tuple[_Variables, _Variables]:
    """Functions of the head's angles, and of the spindle's alone."""
    spindle = np.stack([np.cos(alpha), np.sin(alpha)], axis=1)
    head = np.column_stack([spindle, beta])
    return (
        {
            f"the head's angles{bending}": Variable(_components(_smooth(head / length)))
            for bending, length in _HEAD.items()
        },
        {
            f"the spindle angle{bending}": Variable(_components(_smooth(spindle / length)))
            for bending, length in _SPINDLE.items()
        },
    )


def _shares(order: Float[np.ndarray, " positions"]) -> Float[np.ndarray, "positions 1"]:
    """The time as shares of the whole."""
    return ((order - order.min()) / max(np.ptp(order), 1e-12))[:, None]


def _components(kernel: Float[np.ndarray, "positions positions"]) -> Float[np.ndarray, "positions components"]:
    """Principal components of a process with this covariance."""
    variances, vectors = np.linalg.eigh(kernel)
    variances, vectors = variances[::-1], vectors[:, ::-1]
    kept = np.cumsum(variances) < (1 - _LEFT_OUT) * np.sum(variances)
    count = min(int(np.sum(kept)) + 1, _MOST_COMPONENTS, int(_FOR_EACH * len(kernel)))
    return vectors[:, :count] * np.sqrt(np.maximum(variances[:count], 0.0))


def _smooth(values: Float[np.ndarray, "positions variables"]) -> Float[np.ndarray, "positions positions"]:
    """A Gaussian kernel of length one."""
    return np.exp(-0.5 * np.sum((values[:, None] - values) ** 2, axis=2))


def _sides(direction: Float[np.ndarray, "positions 3"]) -> tuple[np.ndarray, np.ndarray]:
    """Kernels of what falls to one side or the other, and of what is touched on one side alone: sums of steps, and of
    ramps that begin, at planes across the direction of gravity (arc-cosine kernels of order 0 and 1, Cho and Saul 2009)."""
    beside = np.column_stack([direction, np.full(len(direction), _PLANES)])
    cosine = np.clip(beside @ beside.T / (1.0 + _PLANES**2), -1.0, 1.0)
    angle = np.arccos(cosine)
    return 1.0 - angle / np.pi, (np.sqrt(1.0 - cosine**2) + (np.pi - angle) * cosine) / np.pi
