"""Errors without a catalogue entry as Gaussian processes over a variable, with any curve.

Every field (an output, all outputs, the scale factors, an error of the head, a rotation of the triad) is given a process over
the attitude, the inputs, the head's angles, the temperature or the time (`variables`).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes.generic import HEAD_ANGLES
from tumblecal.diagnosis.causes.shapes import products
from tumblecal.diagnosis.causes.table import Blocks
from tumblecal.diagnosis.lack_of_fit.variables import Variable, variables
from tumblecal.diagnosis.priors import LEAST_VISIBLE_TERM, SAME_TERM
from tumblecal.effects import AXES
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.showing import brief


# Products of inputs with the three axes: the turns in the mount.
_CROSS = np.cross(np.eye(3)[:, None], np.eye(3)).swapaxes(1, 2).reshape(3, 9)
# More than a bound by this share may be rounding.
_ROUNDING = 1.001


@dataclass(frozen=True, eq=False)
class Process:
    """A process of `fields`, one or three, each with a separate curve over the variable; `kind` in words; `signals`: each
    field times each component of the variable in the residual space as rows, those of each component together; `seen`: their
    sum of squares; `largest`: the one with the largest."""

    __repr__ = brief

    kind: str
    fields: Float[np.ndarray, "positions 3 fields"]
    variable: Variable
    signals: Float[np.ndarray, "signals nu"]
    seen: float
    largest: Float[np.ndarray, " nu"]

    @property
    def words(self) -> str:
        """Dependent quantity and variable."""
        return f"{self.kind} {self.variable.words}"

    @property
    def width(self) -> int:
        """Number of fields."""
        return self.fields.shape[2]

    @cached_property
    def products(self) -> Float[np.ndarray, "signals signals"]:
        """Products of the signals with each other."""
        return self.signals @ self.signals.T

    def readings(self, direction: Float[np.ndarray, " fields"] | None = None) -> Float[np.ndarray, "positions 3 columns"]:
        """The signals as readings, field after field; those of one curve, of which each field has the shares `direction`."""
        fields = self.fields if direction is None else (self.fields @ direction)[:, :, None]
        return products(fields, self.variable.components)


def visible_processes(at: Tangent, effects: Blocks) -> list[Process]:
    """The processes of which the residuals can show enough, and that are more than one of the effects with these blocks."""
    listed = list(_shown(at))
    largest, seen = np.array([process.largest for process in listed]), np.array([process.seen for process in listed])
    # Two bounds: of all signals no less remains, given an effect, than of the largest; and as many of the components' variances
    # as an effect has directions, r, are together no more than the root of r times the sum of the squares of all.
    near = np.vecdot(largest, largest) - _held(effects, largest).max(axis=0) <= _ROUNDING * (1 - SAME_TERM**2) * seen
    squares = np.array([np.vdot(process.products, process.products) for process in listed])
    near &= effects.ranks.max(initial=0) * squares >= (SAME_TERM**2 / _ROUNDING * seen) ** 2
    if np.any(near):
        signals = [listed[k].signals for k in np.flatnonzero(near).tolist()]
        held = _held(effects, np.concatenate(signals))
        ends = np.cumsum([len(own) for own in signals])
        most = np.add.reduceat(held, [0, *ends[:-1].tolist()], axis=1).max(axis=0)
        near[near] = most >= SAME_TERM**2 * seen[near]
    return [process for process, is_one in zip(listed, near.tolist(), strict=True) if not is_one]


def _shown(at: Tangent) -> Iterator[Process]:
    """The processes of one problem of which the residuals can show enough."""
    inputs, where = np.asarray(at.evaluation.inputs), at.problem.where
    outputs = np.broadcast_to(np.eye(3), (len(inputs), 3, 3))
    scales = inputs[:, :, None] * outputs
    of_time = "smooth", "wandering"
    # Words, fields, kinds of variables.
    kinds = list[tuple[str, np.ndarray, tuple[str, ...]]]()
    slow = [f"input {axis}" for axis in AXES]
    for k, axis in enumerate(AXES):
        followed = ("attitude", "changing", *slow, "quick input", "smooth", "swing")
        kinds.append((f"output {axis}: a function of", outputs[:, :, [k]], followed))
        kinds.append((f"scale factor {axis}: a function of", scales[:, :, [k]], (*slow[:k], *slow[k + 1 :])))
    of_outputs = ("attitude", "side", "lean", *of_time, *(() if at.model.hand_held else ("spindle",)))
    kinds.append(("the outputs: functions of", outputs, of_outputs))
    kinds.append(("the scale factors: functions of", scales, of_time))
    # Unknown attitudes take up any turn.
    if not at.model.hand_held:
        turns, in_mount = at.evaluation.jacobian[:, :, at.model.probe], (inputs @ _CROSS).reshape(-1, 3, 3)
        for k, name in enumerate(HEAD_ANGLES):
            kinds.append((f"{name}: a function of", turns[:, :, [k]], ("head", "spindle", *of_time)))
        kinds.append(("a rotation of the triad: a function of", turns, ("head", "changing", "side", *of_time)))
        kinds.append(("a rotation in the mount: a function of", in_mount, of_time))
    every, responses = variables(inputs, where), at.responses.swapaxes(0, 1)
    for words, fields, followed in kinds:
        # One kind of fields at a time: those of all need more memory than the signals.
        own = [variable for variable in every if variable.kind in followed]
        components, width = np.hstack([variable.components for variable in own]), fields.shape[2]
        ends = np.cumsum([variable.components.shape[1] for variable in own]).tolist()
        starts = [0, *ends[:-1]]
        signals = (components.T @ (responses @ fields).swapaxes(1, 2).reshape(len(inputs), -1)).reshape(-1, at.dof)
        sizes = np.vecdot(signals, signals)
        seen = np.add.reduceat(sizes, width * np.array(starts))
        whole = np.add.reduceat(
            np.sum((fields * at.whole_responses[:, :, None]) ** 2, axis=(1, 2)) @ components**2, starts
        )
        if at.problem.correlated:
            each = (at.problem.rows(products(fields, variable.components)) for variable in own)
            whole = np.array([np.sum(rows**2) for rows in each])
        for k in np.flatnonzero(seen > LEAST_VISIBLE_TERM**2 * whole).tolist():
            here = slice(width * starts[k], width * ends[k])
            largest = signals[here.start + np.argmax(sizes[here])]
            yield Process(words, fields, own[k], signals[here], float(seen[k]), largest)


def _held(effects: Blocks, signals: Float[np.ndarray, "signals nu"]) -> Float[np.ndarray, "effects signals"]:
    """The sum of squares of each signal along each of the effects; 0 without any."""
    squares = (effects.rows @ signals.T) ** 2
    if not len(squares):
        return np.zeros((1, len(signals)))
    return np.add.reduceat(squares, np.cumsum(effects.ranks) - effects.ranks, axis=0)
