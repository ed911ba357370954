"""What may be wrong, in one form for all: a cause. Here the form, and the kind that the catalogue's effects are of."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.model.layout import Slot
from tumblecal.effects import AXES
from tumblecal.estimation.problem import Problem
from tumblecal.ground.showing import brief


# What moves no column.
NO_SLOT = Slot("", 0, (), (), (), (), (), False, lambda where: ())


@dataclass(frozen=True)
class Kind:
    """What all causes of a kind have in common.

    - `fitted`: whether they have coefficients. `named`: whether the catalogue describes them.
    """

    name: str
    fitted: bool = True
    named: bool = True


def _as_it_is(problem: Problem) -> Problem:
    """Undoes nothing: the cause is fitted."""
    return problem


class Cause(NamedTuple):
    """One possible cause of what the nominal model leaves.

    - `label`: what it is called in an explanation: an id, or an id with the positions' names after a colon.
    - `log_weight`, `log_test_weight`: logarithms of its prior weight, in the posterior and in the test.
    - `block` (nu, rank): orthonormal basis of the signal that it can make; None for a cause without a coefficient.
    - `offset` (nu): the signal of a cause without a coefficient.
    - `slot`, `directions`: columns of the full vector that it moves (`NO_SLOT`: none), and how.
    - `terms`: white rows of signals with coefficients of their own, beside the full vector's.
    - `positions`: positions at fault; `left_out`: those of them that the fit does without.
    - `lasting`: nominal parameters that are others from a position on, for good: what is measured later shows it too.
    - `words`: what it is, beside its label.
    - `undone`: the problem with this cause undone, where it is undone rather than fitted.
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
    positions: tuple[int, ...] = ()
    left_out: tuple[int, ...] = ()
    lasting: tuple[str, ...] = ()
    words: str = ""
    undone: Callable[[Problem], Problem] = _as_it_is

    @property
    def named(self) -> bool:
        """Whether the catalogue describes it."""
        return self.kind.named


def id_of(label: str) -> str:
    """The catalogue's id in a label."""
    return label.split(":")[0]


def family_of(id: str) -> tuple[str, str] | None:
    """Kind and axis of an effect that acts on one of the axes."""
    kind, _, axis = id.rpartition(".")
    return (kind, axis) if axis in AXES else None


EFFECT = Kind("effect")
