"""What something that no entry describes may follow: errors of every kind as Gaussian processes, whatever their curve.

Every field (an output, all outputs, the scale factors, an error of the head, a turn of the triad) is given a process over the
attitude, the inputs, the head's angles, the temperature or the time: smooth over a stated correlation length, in steps, bent at
planes across gravity, or swinging in time (Rasmussen and Williams 2006, chapter 4).
"""

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Where
from tumblecal.diagnosis.generic_causes import HEAD_ANGLES
from tumblecal.diagnosis.shape_causes import products
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.effects import AXES


# Correlation lengths of the direction of gravity (rad), of the time and of the temperature (shares of the whole).
_ATTITUDE, _TIMES, _TEMPERATURE = 0.5, (0.05, 0.2), 0.25
# The same of an input, g: smooth curves, and the ripple of a converter.
_INPUT = {"": 0.2, ", quickly bending": 0.07}
# The same of the head's angles and of the spindle's, short and long: what bends little pays little for it. (Of the outputs
# what bends little is a polynomial, which the catalogue has.)
_HEAD, _SPINDLE = {"": 0.5, ", slowly bending": 1.2}, {"": 0.25, ", slowly bending": 0.7}
# Swings in time: how often in the whole, and over which share of it they keep their phase.
_SWINGS, _IN_PHASE = range(3, 12), 0.7
# The prior share, beside any other process, of each count of swings, of which neighbours are alike, and of steps in time, most
# of which are one jump that the catalogue has.
_SHARE = 1 / 3
# What a scale factor may follow beside the time: the inputs of the other axes.
_OTHER_INPUTS = {axis: [f"input {other}" for other in AXES if other != axis] for axis in AXES}
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

    @property
    def width(self) -> int:
        """Number of fields."""
        return self.fields.shape[2]

    def of_one_curve(self, direction: Float[np.ndarray, " fields"]) -> Float[np.ndarray, "positions 3 components"]:
        """The signals of one curve, of which each field has these shares."""
        return products((self.fields @ direction)[:, :, None], self.variable.components)


def processes(at: Tangent) -> Iterator[Process]:
    """All processes for one problem."""
    where, inputs = at.problem.where, np.asarray(at.evaluation.inputs)
    probe = at.evaluation.jacobian[:, :, at.model.probe]
    order, pitch = where.measuring_order, np.asarray(where.index("pitch"))
    smooth, wandering, swings = _of_time(tuple(order.tolist()))
    by_temperature = _by_temperature(where)
    smooth = smooth | _since_change(tuple(order.tolist()), tuple(pitch.tolist()))
    smooth |= {words: Variable(_components(kernel)) for words, kernel in by_temperature.items()}
    attitude, changing, sides, lean = _of_attitude(inputs, order, by_temperature)
    of_inputs = {}
    for k, axis in enumerate(AXES):
        of_inputs |= _smoothly(f"input {axis}", inputs[:, k : k + 1], _INPUT)
    outputs = np.broadcast_to(np.eye(3), (len(inputs), 3, 3))
    scales = inputs[:, :, None] * outputs
    for k, axis in enumerate(AXES):
        for words, variable in (attitude | changing | of_inputs | smooth | swings).items():
            yield Process(f"output {axis}: a function of {words}", outputs[:, :, k : k + 1], variable)
        others = {words: variable for words, variable in of_inputs.items() if words in _OTHER_INPUTS[axis]}
        for words, variable in others.items():
            yield Process(f"scale factor {axis}: a function of {words}", scales[:, :, k : k + 1], variable)
    head, spindle = _of_angles(*(tuple(np.asarray(angle).tolist()) for angle in (where.alpha, where.beta)))
    around = {} if at.model.hand_held else spindle
    for words, variable in (attitude | around | sides | lean | smooth | wandering).items():
        yield Process(f"the outputs: functions of {words}", outputs, variable)
    for words, variable in (smooth | wandering).items():
        yield Process(f"the scale factors: functions of {words}", scales, variable)
    if at.model.hand_held:
        # Unknown attitudes take up any turn.
        return
    head = head | _of_side(where)
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


@lru_cache(maxsize=64)
def _since_change(order: tuple[float, ...], pitch: tuple[int, ...]) -> _Variables:
    """Smooth functions of the time since the pitch was changed, as a share of the longest stay at a setting."""
    time, setting = np.array(order), np.array(pitch)
    if len(set(pitch)) < 2:
        return {}
    turn = np.argsort(time, kind="stable")
    changed = np.concatenate([[True], np.diff(setting[turn]) != 0])
    since = np.zeros(len(time))
    since[turn] = time[turn] - time[turn][changed][np.cumsum(changed) - 1]
    return {"the time since the pitch was changed": Variable(_components(_smooth(_shares(since) / _TIMES[1])))}


def _of_attitude(
    inputs: Float[np.ndarray, "positions 3"],
    order: Float[np.ndarray, " positions"],
    by_temperature: dict[str, Float[np.ndarray, "positions positions"]],
) -> tuple[_Variables, _Variables, _Variables, _Variables]:
    """The attitude; the attitude and what changes slowly; the side to which gravity pulls; what is touched on one side."""
    gravity = inputs / np.linalg.norm(inputs, axis=1, keepdims=True)
    of_gravity, (steps, ramps) = _smooth(gravity / _ATTITUDE), _sides(gravity)
    slowly = {"the time": _smooth(_shares(order) / _TIMES[1])} | by_temperature
    return (
        {"the attitude": Variable(_components(of_gravity))},
        {f"the attitude and {words}": Variable(_components(of_gravity * kernel)) for words, kernel in slowly.items()},
        {"the side to which gravity pulls": Variable(_components(steps))},
        {"the lean to one side": Variable(_components(ramps))},
    )


@lru_cache(maxsize=64)
def _of_angles(alpha: tuple[float, ...], beta: tuple[float, ...]) -> tuple[_Variables, _Variables]:
    """Functions of the head's angles, and of the spindle's alone."""
    spindle = np.stack([np.cos(alpha), np.sin(alpha)], axis=1)
    head = np.column_stack([spindle, beta])
    return _smoothly("the head's angles", head, _HEAD), _smoothly("the spindle angle", spindle, _SPINDLE)


def _smoothly(words: str, values: Float[np.ndarray, "positions variables"], lengths: dict[str, float]) -> _Variables:
    """Smooth functions of the same, with each of these correlation lengths."""
    return {words + bending: Variable(_components(_smooth(values / length))) for bending, length in lengths.items()}


def _by_temperature(where: Where) -> dict[str, Float[np.ndarray, "positions positions"]]:
    """The kernel of smooth functions of the temperature by its words, where it was measured and changed."""
    if where.temperature_degc is None or np.ptp(np.asarray(where.temperature_degc)) == 0:
        return {}
    return {"the temperature": _smooth(_shares(np.asarray(where.temperature_degc, float)) / _TEMPERATURE)}


def _of_side(where: Where) -> _Variables:
    """Functions of the head's angles that change their sign with the side from which a position was approached."""
    if where.approach is None or np.ptp(np.asarray(where.approach)) == 0:
        return {}
    side, alpha = np.asarray(where.approach, float), np.asarray(where.alpha)
    head = np.column_stack([np.cos(alpha), np.sin(alpha), np.asarray(where.beta)])
    kernel = np.outer(side, side) * _smooth(head / _HEAD[", slowly bending"])
    return {"the head's angles, opposite from the two sides": Variable(_components(kernel))}


def _shares(values: Float[np.ndarray, " positions"]) -> Float[np.ndarray, "positions 1"]:
    """The time, or the temperature, as shares of the whole."""
    return ((values - values.min()) / max(np.ptp(values), 1e-12))[:, None]


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
