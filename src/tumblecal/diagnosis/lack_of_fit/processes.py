"""Errors without a catalogue entry as Gaussian processes over a variable, with any curve.

Every field (an output, all outputs, the scale factors, an error of the head, a rotation of the triad) is given a process over
the attitude, the inputs, the head's angles, the temperature or the time (`variables`).
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.causes.generic import HEAD_ANGLES
from tumblecal.diagnosis.causes.shapes import products
from tumblecal.diagnosis.lack_of_fit.variables import Variable, of_angles, of_readings, of_side, of_time
from tumblecal.diagnosis.model.tangent import Tangent
from tumblecal.effects import AXES
from tumblecal.ground.showing import brief


# Numbers of components are made up to multiples of this: so more variables have as many, and are stacked.
_PADDED = 4
# Variables of a scale factor, in addition to the time: the inputs of the other axes.
_OTHER_INPUTS = {axis: [f"input {other}" for other in AXES if other != axis] for axis in AXES}
# Products of inputs with the three axes: the turns in the mount.
_CROSS = np.cross(np.eye(3)[:, None], np.eye(3)).swapaxes(1, 2).reshape(3, 9)


class Process(NamedTuple):
    """Signals of `fields`, one or three, each with a separate curve over the variable."""

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


class Kind(NamedTuple):
    """Processes of the same fields, by their numbers: each of the variables makes one."""

    words: str
    fields: range
    variables: tuple[str, ...]


@dataclass(frozen=True)
class Kinds:
    """All processes as a table, by kind and variable, as determined by the names of the variables.

    `variables`: their words, by which they are numbered.
    """

    variables: tuple[str, ...]
    listed: tuple[Kind, ...]

    @cached_property
    def kind(self) -> Int[np.ndarray, " processes"]:
        """The kind of each."""
        return np.repeat(np.arange(len(self.listed)), [len(kind.variables) for kind in self.listed])

    @cached_property
    def variable(self) -> Int[np.ndarray, " processes"]:
        """The number of the variable of each."""
        number = {words: k for k, words in enumerate(self.variables)}
        return np.array([number[words] for kind in self.listed for words in kind.variables], int)

    @cached_property
    def width(self) -> Int[np.ndarray, " processes"]:
        """The number of fields of each."""
        return np.array([len(kind.fields) for kind in self.listed])[self.kind]

    @cached_property
    def first_field(self) -> Int[np.ndarray, " processes"]:
        """The number of the first field of each."""
        return np.array([kind.fields.start for kind in self.listed])[self.kind]


@dataclass(frozen=True)
class Processes:
    """All processes of a problem.

    `fields` (positions, 3, fields): the outputs, the scale factors, small turns of the head, and of the triad in its mount;
    `variables`: in the order of `kinds`.
    """

    __repr__ = brief

    fields: Float[np.ndarray, "positions 3 fields"]
    variables: tuple[Variable, ...]
    kinds: Kinds

    @cached_property
    def counts(self) -> Int[np.ndarray, " variables"]:
        """How many components each variable is given, some of which may be zero."""
        counts = np.array([variable.components.shape[1] for variable in self.variables])
        return -(-counts // _PADDED) * _PADDED

    @cached_property
    def components(self) -> Float[np.ndarray, "variables most positions"]:
        """The components of each variable as rows, zeros behind them."""
        padded = np.zeros((len(self.variables), np.max(self.counts), len(self.fields)))
        for own, variable in zip(padded, self.variables, strict=True):
            own[: variable.components.shape[1]] = variable.components.T
        return padded

    @cached_property
    def share(self) -> Float[np.ndarray, " processes"]:
        """The prior share of each."""
        return np.array([variable.share for variable in self.variables])[self.kinds.variable]

    def process(self, number: int) -> Process:
        """One of them."""
        kind, variable = self.kinds.listed[self.kinds.kind[number]], int(self.kinds.variable[number])
        words = f"{kind.words} {self.kinds.variables[variable]}"
        return Process(words, self.fields[:, :, kind.fields.start : kind.fields.stop], self.variables[variable])


def processes(at: Tangent) -> Processes:
    """All processes for one problem."""
    where, inputs, held = at.problem.where, np.asarray(at.evaluation.inputs), at.model.hand_held
    order = tuple(where.measuring_order.tolist())
    in_time = of_time(order, tuple(np.asarray(where.index("pitch")).tolist()))
    angles = tuple(tuple(np.asarray(angle).tolist()) for angle in (where.alpha, where.beta))
    approach = None if where.approach is None else tuple(np.asarray(where.approach, float).tolist())
    groups = [*in_time, *of_readings(inputs, order, where), of_side(*angles, approach)]
    outputs = np.broadcast_to(np.eye(3), (len(inputs), 3, 3))
    fields = [outputs, inputs[:, :, None] * outputs]
    # Unknown attitudes take up any turn.
    if not held:
        groups += of_angles(*angles)
        fields += [at.evaluation.jacobian[:, :, at.model.probe], (inputs @ _CROSS).reshape(-1, 3, 3)]
    kinds = _kinds(tuple(tuple(group) for group in groups), held)
    every = {words: variable for group in groups for words, variable in group.items()}
    return Processes(np.concatenate(fields, axis=2), tuple(every[words] for words in kinds.variables), kinds)


@lru_cache(maxsize=64)
def _kinds(groups: tuple[tuple[str, ...], ...], hand_held: bool) -> Kinds:
    """What is followed by what, of the variables' words in the groups of `variables`."""
    smooth, wandering, swings, attitude, changing, sides, lean, of_inputs, thermal, of_side, *angles = groups
    head, spindle = angles or ((), ())
    smooth = smooth + thermal
    kinds = list[Kind]()
    for k, axis in enumerate(AXES):
        followed = attitude + changing + of_inputs + smooth + swings
        kinds.append(Kind(f"output {axis}: a function of", range(k, k + 1), followed))
        others = tuple(words for words in of_inputs if words in _OTHER_INPUTS[axis])
        kinds.append(Kind(f"scale factor {axis}: a function of", range(3 + k, 4 + k), others))
    followed = attitude + spindle + sides + lean + smooth + wandering
    kinds.append(Kind("the outputs: functions of", range(3), followed))
    kinds.append(Kind("the scale factors: functions of", range(3, 6), smooth + wandering))
    if not hand_held:
        head = head + of_side
        for k, name in enumerate(HEAD_ANGLES):
            kinds.append(Kind(f"{name}: a function of", range(6 + k, 7 + k), head + spindle + smooth + wandering))
        followed = head + changing + sides + smooth + wandering
        kinds.append(Kind("a rotation of the triad: a function of", range(6, 9), followed))
        kinds.append(Kind("a rotation in the mount: a function of", range(9, 12), smooth + wandering))
    return Kinds(tuple(dict.fromkeys(words for kind in kinds for words in kind.variables)), tuple(kinds))
