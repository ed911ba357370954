"""A cause, the common form of all possible errors; its kind; words of labels."""

from collections.abc import Callable
from enum import IntEnum
from itertools import groupby
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.effects import AXES
from tumblecal.estimation.problem import Problem
from tumblecal.full_model.layout import Slot
from tumblecal.ground.showing import brief


# A cause that changes no column.
NO_SLOT = Slot("", 0, (), (), (), (), (), False, lambda where: ())
# The label of causes that no entry of the catalogue describes.
UNEXPLAINED = "unexplained"


class Kind(IntEnum):
    """What a cause is; `SWAP` and `MISLABEL` have no coefficients, and no entry describes what is `GENERIC`."""

    EFFECT = 0
    SIGNS = 1
    OUTLIER = 2
    SWAP = 3
    MISLABEL = 4
    JUMP = 5
    CLIPPED = 6
    GENERIC = 7


EFFECT, SIGNS, GENERIC = Kind.EFFECT, Kind.SIGNS, Kind.GENERIC


def _as_it_is(problem: Problem) -> Problem:
    """Undoes nothing: the cause is fitted."""
    return problem


class Cause(NamedTuple):
    """One possible cause of the residuals of the nominal model: a row of a `Pool`.

    - `label`: its name in an explanation: an id, or an id with the names of positions after a colon.
    - `log_weight`, `log_test_weight`: logarithms of its prior weight, in the posterior and in the test.
    - `block` (nu, rank): orthonormal basis of its signal; None for a cause without a coefficient.
    - `offset` (nu): the signal of a cause without a coefficient.
    - `slot`, `directions`: columns of the full vector that it changes (`NO_SLOT`: none), and their directions.
    - `terms`: white rows of signals with separate coefficients, in addition to those of the full vector.
    - `signs`: of the input at each position, for a variant of an effect that jumps with them.
    - `positions`: positions at fault; `left_out`: those of them that the fit excludes.
    - `lasting`: nominal parameters that change at a position and remain so: later measurements show the change too.
    - `words`: its description, in addition to the label.
    - `undone`: the problem with this cause undone, if it is undone and not fitted.
    """

    __repr__ = brief

    kind: Kind
    label: str
    log_weight: float
    log_test_weight: float
    block: Float[np.ndarray, "nu rank"] | None = None
    offset: Float[np.ndarray, " nu"] | None = None
    slot: Slot = NO_SLOT
    directions: Float[np.ndarray, "columns rank"] | None = None
    terms: tuple[Float[np.ndarray, " rows"], ...] = ()
    signs: Float[np.ndarray, " positions"] | None = None
    positions: tuple[int, ...] = ()
    left_out: tuple[int, ...] = ()
    lasting: tuple[str, ...] = ()
    words: str = ""
    undone: Callable[[Problem], Problem] = _as_it_is

    @property
    def named(self) -> bool:
        """Whether the catalogue describes it."""
        return self.kind != GENERIC


def id_of(label: str) -> str:
    """The catalogue's id in a label."""
    return label.split(":")[0]


def label_words(labels: tuple[str, ...]) -> str:
    """`a + b at 1-3`; of a family `c.x, .y, .z`."""
    families = [list(family) for _, family in groupby(labels, key=lambda label: (family_of(label) or (label,))[0])]
    words = (", ".join([first, *("." + label.rpartition(".")[2] for label in others)]) for first, *others in families)
    return " + ".join(name.replace(":", " at ", 1) for name in words)


def family_of(id: str) -> tuple[str, str] | None:
    """Kind and axis of an effect that acts on one of the axes."""
    kind, _, axis = id.rpartition(".")
    return (kind, axis) if axis in AXES else None
