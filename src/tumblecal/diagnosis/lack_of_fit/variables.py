"""Variables of a field: the attitude, the inputs, the angles of the head, the temperature, the time.

Each is the covariance of a Gaussian process over the positions: smooth over a stated correlation length, in steps, bent at
planes across gravity, or swinging in time (Rasmussen and Williams 2006, chapter 4). A process is represented by its principal
components, computed for all processes of a data set at once.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

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
# Numbers of the covariances whose components are computed together.
_NUMBERS_AT_ONCE = 2_000_000


class Variable(NamedTuple):
    """The variable of a field: principal components of a process over it, and its prior share among the variables."""

    components: Float[np.ndarray, "positions components"]
    share: float = 1.0


# Variables, and covariances over the positions, by their words.
Variables = dict[str, Variable]
_Kernels = dict[str, Float[np.ndarray, "positions positions"]]


@lru_cache(maxsize=64)
def of_time(order: tuple[float, ...], pitch: tuple[int, ...]) -> tuple[Variables, Variables, Variables]:
    """Smooth changes in time and since the pitch was changed, those in steps (the covariance of a random walk whose level is
    unknown), and swings."""
    time = _shares(np.array(order))
    smooth = {
        "the time, quickly changing": _smooth(time / TIME_LENGTHS[0]),
        "the time, slowly changing": _smooth(time / TIME_LENGTHS[1]),
    }
    smooth |= _since_change(time, np.array(pitch))
    steps = {"the time, in steps": 1.0 - np.abs(time - time.T)}
    made = _variables(smooth | steps)
    wandering = {words: made.pop(words)._replace(share=WANDERING_SHARE) for words in steps}
    return made, wandering, _swings(time)


def _swings(time: Float[np.ndarray, "positions 1"]) -> Variables:
    """Swings whose phase wanders smoothly: as signals, of which there are fewer than positions."""
    counts = [count for count in SWINGS if 2 * count < len(time) - 1]
    if not counts:
        return {}
    variances, vectors = np.linalg.eigh(_smooth(time / SWING_LENGTH))
    kept = variances > _ROUNDING * variances[-1]
    level, phase = vectors[:, kept] * np.sqrt(variances[kept]), 2 * np.pi * np.array(counts)[:, None, None] * time
    signals = np.concatenate([level * np.cos(phase), level * np.sin(phase)], axis=2)
    variances, mixed = np.linalg.eigh(np.swapaxes(signals, 1, 2) @ signals)
    words = [f"the time, in some {count} swings" for count in counts]
    return _principal(words, variances, signals @ mixed, WANDERING_SHARE)


def _since_change(time: Float[np.ndarray, "positions 1"], setting: Int[np.ndarray, " positions"]) -> _Kernels:
    """Smooth functions of the time since the pitch was changed, as a share of the longest stay at a setting."""
    if np.all(setting == setting[0]):
        return {}
    turn = np.argsort(time[:, 0], kind="stable")
    changed, ordered = np.concatenate([[True], np.diff(setting[turn]) != 0]), time[turn, 0]
    since = np.zeros(len(time))
    since[turn] = ordered - ordered[changed][np.cumsum(changed) - 1]
    return {"the time since the pitch was changed": _smooth(_shares(since) / TIME_LENGTHS[1])}


def of_readings(
    inputs: Float[np.ndarray, "positions 3"], order: tuple[float, ...], where: Where
) -> tuple[Variables, ...]:
    """Variables that depend on the readings: the attitude; the attitude and what changes slowly; the side to which gravity
    pulls; what is touched on one side; the inputs; the temperature."""
    gravity = inputs / np.sqrt(np.vecdot(inputs, inputs))[:, None]
    of_gravity, thermal = _smooth(gravity / ATTITUDE_LENGTH), _Kernels()
    if where.temperature_degc is not None and np.ptp(np.asarray(where.temperature_degc)) > 0:
        thermal["the temperature"] = _smooth(_shares(np.asarray(where.temperature_degc, float)) / TEMPERATURE_LENGTH)
    # Kernels of what falls to one side or the other, and of what is touched on one side alone: sums of steps, and of ramps
    # that begin, at planes across the direction of gravity (arc-cosine kernels of order 0 and 1, Cho and Saul 2009).
    extended = np.column_stack([gravity, np.full(len(gravity), PLANES)])
    cosine = np.clip(extended @ extended.T / (1.0 + PLANES**2), -1.0, 1.0)
    angle = np.arccos(cosine)
    steps, ramps = 1.0 - angle / np.pi, (np.sqrt(1.0 - cosine**2) + (np.pi - angle) * cosine) / np.pi
    slowly = {"the time": _smooth(_shares(np.array(order)) / TIME_LENGTHS[1])} | thermal
    of_inputs = _smooth((inputs.T[:, None] / np.array([[*INPUT_LENGTHS.values()]]).T).reshape(-1, len(inputs), 1))
    listed: list[_Kernels] = [
        {"the attitude": of_gravity},
        {f"the attitude and {words}": of_gravity * kernel for words, kernel in slowly.items()},
        {"the side to which gravity pulls": steps},
        {"the lean to one side": ramps},
        dict(zip((f"input {axis}{bending}" for axis in AXES for bending in INPUT_LENGTHS), of_inputs, strict=True)),
        thermal,
    ]
    made = _variables({words: kernel for kernels in listed for words, kernel in kernels.items()})
    return tuple({words: made[words] for words in kernels} for kernels in listed)


@lru_cache(maxsize=64)
def of_angles(alpha: tuple[float, ...], beta: tuple[float, ...]) -> tuple[Variables, Variables]:
    """Functions of the head's angles, and of the spindle's alone."""
    spindle = np.stack([np.cos(alpha), np.sin(alpha)], axis=1)
    head = np.column_stack([spindle, beta])
    return (
        _variables({f"the head's angles{bending}": _smooth(head / length) for bending, length in HEAD_LENGTHS.items()}),
        _variables(
            {f"the spindle angle{bending}": _smooth(spindle / length) for bending, length in SPINDLE_LENGTHS.items()}
        ),
    )


@lru_cache(maxsize=64)
def of_side(alpha: tuple[float, ...], beta: tuple[float, ...], approach: tuple[float, ...] | None) -> Variables:
    """Functions of the head's angles that change their sign with the side from which a position was approached."""
    if approach is None or np.ptp(approach) == 0:
        return {}
    head = np.column_stack([np.cos(alpha), np.sin(alpha), beta])
    kernel = np.outer(approach, approach) * _smooth(head / HEAD_LENGTHS[", slowly bending"])
    return _variables({"the head's angles, opposite from the two sides": kernel})


def _shares(values: Float[np.ndarray, " positions"]) -> Float[np.ndarray, "positions 1"]:
    """The time, or the temperature, as shares of the whole."""
    return ((values - values.min()) / max(np.ptp(values), 1e-12))[:, None]


def _variables(kernels: _Kernels) -> Variables:
    """Principal components of processes with these covariances; a few at once, because their vectors are as large."""
    words, made = list(kernels), Variables()
    step = 1 + _NUMBERS_AT_ONCE // max(kernel.size for kernel in kernels.values()) if kernels else 1
    for first in range(0, len(words), step):
        some = words[first : first + step]
        variances, vectors = np.linalg.eigh(np.stack([kernels[name] for name in some]))
        vectors *= np.sqrt(np.maximum(variances, 0.0))[:, None]
        made |= _principal(some, variances, vectors)
    return made


def _principal(
    words: Sequence[str],
    variances: Float[np.ndarray, "processes components"],
    components: Float[np.ndarray, "processes positions components"],
    share: float = 1.0,
) -> Variables:
    """Of components in rising order those that are taken."""
    carried = np.cumsum(np.maximum(variances[:, ::-1], 0.0), axis=1)
    counts = np.sum(carried < (1 - OMITTED_VARIANCE) * carried[:, -1:], axis=1) + 1
    counts = np.minimum(counts, min(MOST_COMPONENTS, int(COMPONENTS_PER_POSITION * components.shape[1])))
    return {
        name: Variable(own[:, ::-1][:, :count].copy(), share)
        for name, own, count in zip(words, components, counts.tolist(), strict=True)
    }


def _smooth(values: Float[np.ndarray, "*sets positions variables"]) -> Float[np.ndarray, "*sets positions positions"]:
    """A Gaussian kernel of length one."""
    difference = values[..., :, None, :] - values[..., None, :, :]
    return np.exp(-0.5 * np.vecdot(difference, difference))
