"""What may be wrong, in one form for all: a cause. Here the protocol, and an effect of the catalogue as one."""

from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.model.layout import Slot
from tumblecal.effects import AXES, Effect
from tumblecal.estimation.problem import Problem
from tumblecal.ground.showing import brief


# What moves no column.
NO_SLOT = Slot("", 0, (), (), (), (), (), False, lambda where: ())


class Cause(Protocol):
    """One possible cause of what the nominal model leaves.

    - `label`: what it is called in an explanation: an id, or an id with the positions' names after a colon.
    - `log_weight`, `log_test_weight`: logarithms of its prior weight, in the posterior and in the test.
    - `block` (nu, rank): orthonormal basis of the signal that it can make; None for a cause without a coefficient.
    - `offset` (nu): the signal of a cause without a coefficient.
    - `slot`, `directions`: columns of the full vector that it moves (`NO_SLOT`: none), and how.
    - `terms`: white rows of signals with coefficients of their own, beside the full vector's.
    - `positions`: positions at fault; `left_out`: those of them that the fit does without.
    - `family`: kind and axis, where there is the same for each axis. `named`: whether the catalogue describes it.
    - `words`: what it is, beside its label.
    """

    @property
    def label(self) -> str: ...  # noqa: D102
    @property
    def log_weight(self) -> float: ...  # noqa: D102
    @property
    def log_test_weight(self) -> float: ...  # noqa: D102
    @property
    def block(self) -> np.ndarray | None: ...  # noqa: D102
    @property
    def offset(self) -> np.ndarray | None: ...  # noqa: D102
    @property
    def slot(self) -> Slot: ...  # noqa: D102
    @property
    def directions(self) -> np.ndarray | None: ...  # noqa: D102
    @property
    def terms(self) -> tuple[np.ndarray, ...]: ...  # noqa: D102
    @property
    def positions(self) -> tuple[int, ...]: ...  # noqa: D102
    @property
    def left_out(self) -> tuple[int, ...]: ...  # noqa: D102
    @property
    def family(self) -> tuple[str, str] | None: ...  # noqa: D102
    @property
    def named(self) -> bool: ...  # noqa: D102
    @property
    def words(self) -> str: ...  # noqa: D102

    def undone(self, problem: Problem) -> Problem:
        """The problem with this cause undone, where it is undone rather than fitted."""
        ...

    def told(self, entry: Effect | None, sizes: str) -> str:
        """What it is and what to do, in words; `sizes`: its fitted coefficients in words."""
        ...

    def _replace(self, **changed: Any) -> Self: ...


def id_of(label: str) -> str:
    """The catalogue's id in a label."""
    return label.split(":")[0]


def family_of(id: str) -> tuple[str, str] | None:
    """Kind and axis of an effect that acts on one of the axes."""
    kind, _, axis = id.rpartition(".")
    return (kind, axis) if axis in AXES else None


class EffectCause(NamedTuple):
    """An effect of the catalogue."""

    __repr__ = brief

    label: str
    log_weight: float
    log_test_weight: float
    block: Float[np.ndarray, "nu rank"] | None
    slot: Slot
    directions: Float[np.ndarray, "columns rank"] | None

    offset = None
    terms = ()
    positions = ()
    left_out = ()
    named = True
    words = ""

    @property
    def family(self) -> tuple[str, str] | None:
        """Kind and axis (`second_order`, `x`)."""
        return family_of(self.label)

    def undone(self, problem: Problem) -> Problem:
        """The same problem: the effect is fitted."""
        return problem

    def told(self, entry: Effect | None, sizes: str) -> str:
        """Its coefficients, what it is and what to do."""
        assert entry is not None
        return f"{sizes}. {entry.cause} {entry.advice}"
