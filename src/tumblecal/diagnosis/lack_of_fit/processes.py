"""Errors without a catalogue entry as Gaussian processes over a variable, with any curve.

Every field (an output, all outputs, the scale factors, an error of the head, a rotation of the triad) is given a process over
the attitude, the inputs, the head's angles, the temperature or the time (`variables`).
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.causes.terms import HEAD_ANGLES, products
from tumblecal.diagnosis.lack_of_fit.variables import Variable, of_angles, of_readings, of_side, of_time
from tumblecal.effects import AXES
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.showing import brief


# Numbers of components are made up to multiples of this: so more variables have as many, and are stacked.
_PADDED = 4
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


class Kinds(NamedTuple):
    """All processes as a table, as determined by the names of the variables: `words` of the kinds and `variables`; kind,
    variable, first field and number of fields of each process."""

    words: tuple[str, ...]
    variables: tuple[str, ...]
    kind: Int[np.ndarray, " processes"]
    variable: Int[np.ndarray, " processes"]
    first_field: Int[np.ndarray, " processes"]
    width: Int[np.ndarray, " processes"]


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
        kinds, variable, first = self.kinds, int(self.kinds.variable[number]), int(self.kinds.first_field[number])
        words = f"{kinds.words[kinds.kind[number]]} {kinds.variables[variable]}"
        return Process(words, self.fields[:, :, first : first + int(kinds.width[number])], self.variables[variable])


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
    """Which fields follow which of the variables' words in the groups of `variables`."""
    smooth, wandering, swings, attitude, changing, sides, lean, of_inputs, thermal, of_side, *angles = groups
    head, spindle = angles or ((), ())
    smooth, head = smooth + thermal, head + of_side
    # Words, first field, number of fields, variables.
    kinds = list[tuple[str, int, int, tuple[str, ...]]]()
    for k, axis in enumerate(AXES):
        kinds.append((f"output {axis}: a function of", k, 1, attitude + changing + of_inputs + smooth + swings))
        others = tuple(words for words in of_inputs if words in [f"input {other}" for other in AXES if other != axis])
        kinds.append((f"scale factor {axis}: a function of", 3 + k, 1, others))
    kinds.append(("the outputs: functions of", 0, 3, attitude + spindle + sides + lean + smooth + wandering))
    kinds.append(("the scale factors: functions of", 3, 3, smooth + wandering))
    if not hand_held:
        for k, name in enumerate(HEAD_ANGLES):
            kinds.append((f"{name}: a function of", 6 + k, 1, head + spindle + smooth + wandering))
        kinds.append(("a rotation of the triad: a function of", 6, 3, head + changing + sides + smooth + wandering))
        kinds.append(("a rotation in the mount: a function of", 9, 3, smooth + wandering))
    words, first, width, followed = zip(*kinds, strict=True)
    variables = tuple(dict.fromkeys(name for own in followed for name in own))
    kind = np.repeat(np.arange(len(kinds)), [len(own) for own in followed])
    variable = np.array([variables.index(name) for own in followed for name in own], int)
    return Kinds(words, variables, kind, variable, np.array(first)[kind], np.array(width)[kind])
