"""What may be wrong, in one form for all: a cause. Here the protocol, and the causes that are effects of the catalogue."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.layout import Slot
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.diagnosis.tuning import EFFECT_TEST_WEIGHT, EFFECT_WEIGHT, SECOND_ORDER, VISIBLE
from tumblecal.effects import AXES, Effect
from tumblecal.estimation.identifiability import RANK_TOLERANCE, sparse_basis
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
        """The coefficients' direction that is absorbed most, and its signal; None when every direction is visible.

        Of several equal ones, any of whose mixtures is absorbed too, that of few coefficients that begins with the first.
        """
        if not self.hidden.shape[1]:
            return None
        hidden = sparse_basis(self.hidden) if self.hidden.shape[1] > 1 else self.hidden
        signals = jacobian[:, list(self.slot.columns)] @ hidden
        norms = np.linalg.norm(signals, axis=0)
        equal = np.flatnonzero(norms >= (1 - _ALIKE) * np.max(norms)).tolist()
        most = min(equal, key=lambda column: int(np.argmax(hidden[:, column] != 0)))
        # Its sign is free: the largest coefficient is positive, the first of equal ones.
        sizes = np.abs(hidden[:, most])
        sign = np.sign(hidden[np.argmax(sizes >= (1 - _ALIKE) * np.max(sizes)), most])
        return hidden[:, most] * sign, signals[:, most] * sign


# Sizes that differ by a smaller share are equal but for how exactly the triad stands.
_ALIKE = 0.05
_ONE, _NONE = np.ones((1, 1)), np.zeros((1, 0))


def visibilities(
    varying: Float[np.ndarray, "effects rows columns"],
    seen: Float[np.ndarray, "effects nu columns"],
    slots: Sequence[Slot],
    share: float | Float[np.ndarray, " effects"],
    rounding: float,
) -> list[Visibility]:
    """Split the coefficient directions of effects with equally many into those that the residuals can show and those
    absorbed.

    **Arguments:**

    - `varying`: Jacobian of each effect's coefficients without what only the scale of temperature adds; `seen`: the
      Jacobian in the residual space.
    - `share` of a direction's signal that the nominal model must leave; a signal of the norm `rounding` is none.
    """
    projected, whole = np.sqrt(np.sum(seen**2, axis=1)), np.sqrt(np.sum(varying**2, axis=1))
    least = np.broadcast_to(share, len(slots))
    if seen.shape[2] == 1:
        shown = projected[:, 0] > np.maximum(least * whole[:, 0], rounding)
        blocks = seen / np.maximum(projected, 1e-300)[:, None]
        return [
            Visibility(slot, block, _ONE, _NONE, *sizes)
            if here
            else Visibility(slot, block[:, :0], _NONE, _ONE, *sizes)
            for slot, here, block, *sizes in zip(slots, shown.tolist(), blocks, projected, whole, strict=True)
        ]
    left, singular, right = np.linalg.svd(seen, full_matrices=seen.shape[1] < seen.shape[2])
    singular = np.pad(singular, ((0, 0), (0, right.shape[1] - singular.shape[1])))
    turned = np.swapaxes(right, 1, 2)
    unprojected = np.sqrt(np.sum((varying @ turned) ** 2, axis=1))
    shown = singular > np.maximum(least[:, None] * unprojected, rounding)
    blocks = zip(slots, left, turned, shown, projected, whole, strict=True)
    return [
        Visibility(slot, block[:, here[: block.shape[1]]], turn[:, here], turn[:, ~here], *sizes)
        for slot, block, turn, here, *sizes in blocks
    ]


def effect_causes(at: Tangent) -> tuple[list[Cause], list[Visibility]]:
    """Causes for every visible effect, and the visibility of all of them."""
    seen = _seen(at)
    shown = [seen_effect for seen_effect in seen if seen_effect.block.shape[1]]
    weights = {seen_effect.slot.id: seen_effect.slot.weight for seen_effect in shown}
    variants = dict.fromkeys(weights, 0.0)
    for seen_effect in shown:
        variants[seen_effect.slot.id] += seen_effect.slot.share
    total = sum(weights.values())
    causes: list[Cause] = []
    for slot, block, directions, *_ in shown:
        share = math.log(slot.weight / total * slot.share / variants[slot.id])
        weight, test_weight = share + math.log(EFFECT_WEIGHT), share + math.log(EFFECT_TEST_WEIGHT)
        causes.append(EffectCause(slot.id, weight, test_weight, block, slot, directions))
    return causes, seen


def _seen(at: Tangent) -> list[Visibility]:
    """The visibility of every effect, in the model's order."""
    layout, projected = at.model.layout, at.basis.T @ at.jacobian
    nominal = at.varying[:, : layout.nominal]
    rounding = RANK_TOLERANCE * float(np.sqrt(np.max(np.sum(nominal**2, axis=0))))
    listed: dict[int, Visibility] = {}
    for numbers, columns in layout.by_width.values():
        # Around the exact fit of an effect nothing is lost to the linearisation: what shows of it in the second order counts.
        share = np.where(np.any(at.vector[columns], axis=1), SECOND_ORDER, VISIBLE)
        varying, shown = (np.ascontiguousarray(np.moveaxis(own[:, columns], 1, 0)) for own in (at.varying, projected))
        slots = [layout.slots[k] for k in numbers.tolist()]
        listed |= zip(numbers.tolist(), visibilities(varying, shown, slots, share, rounding), strict=True)
    return [listed[k] for k in range(len(layout.slots))]
