"""Visibility of an effect: the directions of its coefficients that the nominal model does not absorb."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.estimation.identifiability import RANK_TOLERANCE, sparse_basis
from tumblecal.full_model.layout import Slot
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.showing import brief


# Sizes that differ by a smaller share are equal, except for the exact orientation of the triad.
_ALIKE = 0.05


class Visibility(NamedTuple):
    """Visibility of an effect. `block`: its visible orthonormal part; `directions`: the directions of the coefficients that
    produce it; `hidden`: the absorbed ones; `projected`: norm in the residual space of one scale unit of each coefficient;
    `whole`: that before the projection (of temperature only the variation)."""

    __repr__ = brief

    slot: Slot
    block: Float[np.ndarray, "nu rank"]
    directions: Float[np.ndarray, "columns rank"]
    hidden: Float[np.ndarray, "columns absorbed"]
    projected: Float[np.ndarray, " columns"]
    whole: Float[np.ndarray, " columns"]

    def absorbed_most(
        self, jacobian: Float[np.ndarray, "rows full"]
    ) -> tuple[Float[np.ndarray, " columns"], Float[np.ndarray, " rows"]]:
        """The coefficients' direction that is absorbed most, and its signal; of an effect that has such directions.

        Of several equal ones, any of whose mixtures is absorbed too, that of few coefficients that begins with the first.
        """
        hidden, columns, most = self.hidden, list(self.slot.columns), 0
        if hidden.shape[1] > 1:
            hidden = sparse_basis(hidden)
            norms = np.linalg.norm(jacobian[:, columns] @ hidden, axis=0)
            equal = np.flatnonzero(norms >= (1 - _ALIKE) * np.max(norms)).tolist()
            most = min(equal, key=lambda column: int(np.argmax(hidden[:, column] != 0)))
        # Its sign is free: the largest coefficient is positive, the first of equal ones.
        sizes = np.abs(hidden[:, most])
        direction = hidden[:, most] * np.sign(hidden[np.argmax(sizes >= (1 - _ALIKE) * sizes.max()), most])
        return direction, jacobian[:, columns] @ direction


class Visibilities(NamedTuple):
    """`Visibility` of effects with equally many coefficients, side by side: orthonormal `signals` as rows, the directions
    `turned` of the coefficients that make them, and which of them are `shown`."""

    __repr__ = brief

    signals: Float[np.ndarray, "effects least nu"]
    turned: Float[np.ndarray, "effects columns columns"]
    shown: Bool[np.ndarray, "effects columns"]
    projected: Float[np.ndarray, "effects columns"]
    whole: Float[np.ndarray, "effects columns"]

    @property
    def rows(self) -> Float[np.ndarray, "shown nu"]:
        """The signals that are shown, one effect after the other."""
        return self.signals[self.shown[:, : self.signals.shape[1]]]

    def of(self, number: int, slot: Slot) -> Visibility:
        """The visibility of one effect."""
        signals, turned, shown, *sizes = (values[number] for values in self)
        return Visibility(slot, signals[shown[: len(signals)]].T, turned[:, shown], turned[:, ~shown], *sizes)


def visibilities(
    varying: Float[np.ndarray, "effects columns rows"],
    seen: Float[np.ndarray, "effects columns nu"],
    share: float | Float[np.ndarray, " effects"],
    rounding: float | Float[np.ndarray, " effects"],
) -> Visibilities:
    """Split the coefficient directions of effects with equally many into those that the residuals can show and those
    absorbed.

    **Arguments:**

    - `varying`: Jacobian of each effect's coefficients, as rows, without the contribution of the temperature scale's origin;
      `seen`: the Jacobian in the residual space.
    - `share` of a direction's signal that the nominal model must leave; a signal of the norm `rounding` is none.
    """
    projected, whole = (np.sqrt(np.vecdot(rows, rows)) for rows in (seen, varying))
    least, rounding = np.reshape(share, (-1, 1)), np.reshape(rounding, (-1, 1))
    if seen.shape[1] == 1:
        shown, turned = projected > np.maximum(least * whole, rounding), np.ones((len(seen), 1, 1))
        return Visibilities(seen / np.maximum(projected, 1e-300)[:, :, None], turned, shown, projected, whole)
    turned, singular, signals = np.linalg.svd(seen, full_matrices=seen.shape[1] > seen.shape[2])
    mixed, shown = turned.mT @ varying, np.zeros(projected.shape, bool)
    unprojected = np.sqrt(np.vecdot(mixed, mixed))[:, : singular.shape[1]]
    shown[:, : singular.shape[1]] = singular > np.maximum(least * unprojected, rounding)
    return Visibilities(signals, turned, shown, projected, whole)


def least_signal(at: Tangent) -> float:
    """Norm of a signal in the residual space that is none."""
    nominal = at.jacobian[:, : at.model.nominal]
    return RANK_TOLERANCE * float(np.sqrt(np.max(np.sum(nominal**2, axis=0))))
