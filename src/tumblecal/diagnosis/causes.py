"""What may be wrong, in one form for all: a cause. Here the protocol, and the causes that are effects of the catalogue."""

from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.full_model import Slot
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.diagnosis.tuning import EFFECT_TEST_WEIGHT, EFFECT_WEIGHT, SECOND_ORDER, VISIBLE
from tumblecal.effects import AXES, Effect
from tumblecal.estimation.identifiability import RANK_TOLERANCE
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
        kind, _, axis = self.label.rpartition(".")
        return (kind, axis) if axis in AXES else None

    def undone(self, problem: Problem) -> Problem:
        """The same problem: the effect is fitted."""
        return problem

    def told(self, entry: Effect | None, sizes: str) -> str:
        """Its coefficients, what it is and what to do."""
        assert entry is not None
        return f"{sizes}. {entry.cause} {entry.advice}"


class Visibility(NamedTuple):
    """What the nominal model leaves of an effect: `block` its visible orthonormal part, `directions` the coefficients'
    directions that make it, `hidden` those that are absorbed; `projected` the norm in the residual space of one scale
    unit of each coefficient, `whole` that before the projection (of temperature only what varies)."""

    __repr__ = brief

    slot: Slot
    block: Float[np.ndarray, "nu rank"]
    directions: Float[np.ndarray, "columns rank"]
    hidden: Float[np.ndarray, "columns absorbed"]
    projected: Float[np.ndarray, " columns"]
    whole: Float[np.ndarray, " columns"]

    def absorbed_most(
        self, jacobian: Float[np.ndarray, "rows full"]
    ) -> tuple[Float[np.ndarray, " columns"], Float[np.ndarray, " rows"]] | None:
        """The coefficients' direction that is absorbed most, and its signal; None when every direction is visible."""
        if not self.hidden.shape[1]:
            return None
        signals = jacobian[:, list(self.slot.columns)] @ self.hidden
        most = int(np.argmax(np.linalg.norm(signals, axis=0)))
        # Its sign is free: the largest coefficient is positive.
        sign = np.sign(self.hidden[np.argmax(np.abs(self.hidden[:, most])), most])
        return self.hidden[:, most] * sign, signals[:, most] * sign


_ONE, _NONE = np.ones((1, 1)), np.zeros((1, 0))


def visibility(
    varying: Float[np.ndarray, "rows columns"],
    seen: Float[np.ndarray, "nu columns"],
    projected: Float[np.ndarray, " columns"],
    whole: Float[np.ndarray, " columns"],
    slot: Slot,
    share: float,
    rounding: float,
) -> Visibility:
    """Split an effect's coefficient directions into those that the residuals can show and those absorbed.

    **Arguments:**

    - `varying`: Jacobian of the effect's coefficients without what only the scale of temperature adds; `seen`: the
      Jacobian in the residual space.
    - `whole`, `projected`: norms of their columns.
    - `share` of a direction's signal that the nominal model must leave; a signal of the norm `rounding` is none.
    """
    if seen.shape[1] == 1:
        shown = projected[0] > max(share * whole[0], rounding)
        block = seen / projected if shown else seen[:, :0]
        return Visibility(slot, block, _ONE if shown else _NONE, _NONE if shown else _ONE, projected, whole)
    left, singular, right = np.linalg.svd(seen, full_matrices=seen.shape[0] < seen.shape[1])
    singular = np.concatenate([singular, np.zeros(len(right) - len(singular))])
    unprojected = np.linalg.norm(varying @ right.T, axis=0)
    shown = singular > np.maximum(share * unprojected, rounding)
    return Visibility(slot, left[:, shown[: left.shape[1]]], right.T[:, shown], right.T[:, ~shown], projected, whole)


def effect_causes(at: Tangent) -> tuple[list[Cause], list[Visibility]]:
    """Causes for every visible effect, and the visibility of all of them."""
    projected = at.basis.T @ at.jacobian
    sizes, wholes = np.linalg.norm(projected, axis=0), np.linalg.norm(at.varying, axis=0)
    rounding, seen = RANK_TOLERANCE * float(np.max(wholes[: at.model.nominal])), []
    for slot in at.model.slots:
        columns = list(slot.columns)
        if len(columns) == columns[-1] - columns[0] + 1:
            columns = slice(columns[0], columns[-1] + 1)
        # Around the exact fit of an effect nothing is lost to the linearisation: what shows of it in the second order counts.
        share = SECOND_ORDER if np.any(at.vector[columns]) else VISIBLE
        rows = at.varying[:, columns], projected[:, columns], sizes[columns], wholes[columns]
        seen.append(visibility(*rows, slot, share, rounding))
    shown = [seen_effect for seen_effect in seen if seen_effect.block.shape[1]]
    weights = {seen_effect.slot.id: seen_effect.slot.weight for seen_effect in shown}
    variants = dict.fromkeys(weights, 0.0)
    for seen_effect in shown:
        variants[seen_effect.slot.id] += seen_effect.slot.share
    causes: list[Cause] = []
    for seen_effect in shown:
        slot = seen_effect.slot
        share = np.log(slot.weight / sum(weights.values()) * slot.share / variants[slot.id])
        causes.append(
            EffectCause(
                slot.id,
                float(share + np.log(EFFECT_WEIGHT)),
                float(share + np.log(EFFECT_TEST_WEIGHT)),
                seen_effect.block,
                slot,
                seen_effect.directions,
            )
        )
    return causes, seen
