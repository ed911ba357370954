"""What something that no entry describes may follow: errors of every kind as Gaussian processes, whatever their curve.

Every field (an output, all outputs, the scale factors, an error of the head, a turn of the triad) is given a process over the
attitude, the inputs, the head's angles, the temperature or the time (`variables`).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.causes.generic import HEAD_ANGLES
from tumblecal.diagnosis.causes.shapes import products
from tumblecal.diagnosis.lack_of_fit.variables import Variable, Variables, of_angles, of_readings, of_time
from tumblecal.diagnosis.model.tangent import Tangent
from tumblecal.effects import AXES
from tumblecal.ground.showing import brief


# Numbers of components are made up to multiples of this: so more variables have as many, and are stacked.
_PADDED = 4
# What a scale factor may follow beside the time: the inputs of the other axes.
_OTHER_INPUTS = {axis: [f"input {other}" for other in AXES if other != axis] for axis in AXES}


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


class Kind(NamedTuple):
    """Processes of the same fields, by their numbers: each of the variables makes one."""

    words: str
    fields: range
    variables: tuple[str, ...]


@dataclass(frozen=True)
class Processes:
    """All processes of a problem as a table: kind after kind, variable after variable.

    `fields` (positions, 3, fields): the outputs, the scale factors, small turns of the head, and of the triad in its mount;
    `variables`: by their words.
    """

    __repr__ = brief

    fields: Float[np.ndarray, "positions 3 fields"]
    variables: Variables
    kinds: tuple[Kind, ...]

    @cached_property
    def kind(self) -> Int[np.ndarray, " processes"]:
        """The kind of each."""
        return np.repeat(np.arange(len(self.kinds)), [len(kind.variables) for kind in self.kinds])

    @cached_property
    def variable(self) -> Int[np.ndarray, " processes"]:
        """The number of the variable of each."""
        number = {words: k for k, words in enumerate(self.variables)}
        return np.array([number[words] for kind in self.kinds for words in kind.variables], int)

    @cached_property
    def width(self) -> Int[np.ndarray, " processes"]:
        """The number of fields of each."""
        return np.array([len(kind.fields) for kind in self.kinds])[self.kind]

    @cached_property
    def first_field(self) -> Int[np.ndarray, " processes"]:
        """The number of the first field of each."""
        return np.array([kind.fields.start for kind in self.kinds])[self.kind]

    @cached_property
    def counts(self) -> Int[np.ndarray, " variables"]:
        """How many components each variable is given, some of which may be zero."""
        counts = np.array([variable.components.shape[1] for variable in self.variables.values()])
        return -(-counts // _PADDED) * _PADDED

    @cached_property
    def components(self) -> Float[np.ndarray, "variables positions most"]:
        """The components of each variable, zeros behind them."""
        padded = np.zeros((len(self.variables), len(self.fields), np.max(self.counts)))
        for own, variable in zip(padded, self.variables.values(), strict=True):
            own[:, : variable.components.shape[1]] = variable.components
        return padded

    @cached_property
    def share(self) -> Float[np.ndarray, " processes"]:
        """The prior share of each."""
        return np.array([variable.share for variable in self.variables.values()])[self.variable]

    def process(self, number: int) -> Process:
        """One of them."""
        kind, words = self.kinds[self.kind[number]], list(self.variables)[self.variable[number]]
        return Process(
            f"{kind.words} {words}", self.fields[:, :, kind.fields.start : kind.fields.stop], self.variables[words]
        )


def processes(at: Tangent) -> Processes:
    """All processes for one problem."""
    where, inputs = at.problem.where, np.asarray(at.evaluation.inputs)
    order = where.measuring_order
    smooth, wandering, swings = of_time(tuple(order.tolist()), tuple(np.asarray(where.index("pitch")).tolist()))
    attitude, changing, sides, lean, of_inputs, thermal, of_side = of_readings(inputs, order, where)
    smooth = smooth | thermal
    outputs, head, spindle = np.broadcast_to(np.eye(3), (len(inputs), 3, 3)), Variables(), Variables()
    fields, kinds = [outputs, inputs[:, :, None] * outputs], list[Kind]()
    if not at.model.hand_held:
        head, spindle = of_angles(*(tuple(np.asarray(angle).tolist()) for angle in (where.alpha, where.beta)))
        head = head | of_side
    for k, axis in enumerate(AXES):
        followed = attitude | changing | of_inputs | smooth | swings
        kinds.append(Kind(f"output {axis}: a function of", range(k, k + 1), tuple(followed)))
        others = tuple(words for words in of_inputs if words in _OTHER_INPUTS[axis])
        kinds.append(Kind(f"scale factor {axis}: a function of", range(3 + k, 4 + k), others))
    followed = attitude | spindle | sides | lean | smooth | wandering
    kinds.append(Kind("the outputs: functions of", range(3), tuple(followed)))
    kinds.append(Kind("the scale factors: functions of", range(3, 6), tuple(smooth | wandering)))
    # Unknown attitudes take up any turn.
    if not at.model.hand_held:
        in_mount = np.cross(inputs[:, None], np.eye(3)).swapaxes(1, 2)
        fields += [at.evaluation.jacobian[:, :, at.model.probe], in_mount]
        for k, name in enumerate(HEAD_ANGLES):
            kinds.append(
                Kind(f"{name}: a function of", range(6 + k, 7 + k), tuple(head | spindle | smooth | wandering))
            )
        followed = head | changing | sides | smooth | wandering
        kinds.append(Kind("a turn of the triad: a function of", range(6, 9), tuple(followed)))
        kinds.append(Kind("a turn in the mount: a function of", range(9, 12), tuple(smooth | wandering)))
    every = attitude | changing | of_inputs | smooth | swings | spindle | sides | lean | wandering | head
    return Processes(np.concatenate(fields, axis=2), every, tuple(kinds))
