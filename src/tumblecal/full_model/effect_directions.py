"""Directions of the coefficients of the catalogue's effects, each of the effect's typical size, and their contributions."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.effects import Catalogue, Effect
from tumblecal.full_model.full_model import FullModel
from tumblecal.full_model.layout import Slot
from tumblecal.full_model.tangent import Tangent
from tumblecal.full_model.visibility import Visibilities
from tumblecal.ground.showing import brief
from tumblecal.ground.units import factor


# Stated with the data (--gravity), or an input of the budget.
NOT_CONSIDERED = ("gravity_value",)
_OF_EVERY_SENSOR = ("bias_temperature", "scale_temperature")


class EffectDirections(NamedTuple):
    """Directions of the coefficients of effects, of typical size.

    - `steps`: each as a row of the scaled full vector. `numbers`: whose each is among `ids`.
    - `shown`: whether the residuals of the nominal model can show it.
    """

    __repr__ = brief

    steps: Float[np.ndarray, "directions full"]
    numbers: Int[np.ndarray, " directions"]
    ids: tuple[str, ...]
    shown: Bool[np.ndarray, " directions"]

    def of(self, ids: Collection[str]) -> Bool[np.ndarray, " directions"]:
        """Which directions are those of some effects."""
        return np.array([id in ids for id in self.ids], bool)[self.numbers]

    def only(self, chosen: Bool[np.ndarray, " directions"]) -> "EffectDirections":
        """Some of the directions."""
        kept, numbers = np.unique(self.numbers[chosen], return_inverse=True)
        ids = tuple([self.ids[number] for number in kept.tolist()])
        return EffectDirections(self.steps[chosen], numbers, ids, self.shown[chosen])


@dataclass(frozen=True)
class UndetectedEffects:
    """Contribution of effects that are not written to some quantities.

    - `covariance`: mean square of the shifts about the values that are written.
    - `shifts`: of the quantities by one unit of each direction of the effects' coefficients; `steps`: the direction in the
      scaled full vector; `products`: mean products of the coefficients, given the data; `numbers`: whose each is among `ids`.
    - `named`: the directions of effects that are written.
    """

    __repr__ = brief

    covariance: Float[np.ndarray, "quantities quantities"]
    shifts: Float[np.ndarray, "quantities directions"]
    steps: Float[np.ndarray, "directions full"]
    products: Float[np.ndarray, "directions directions"]
    numbers: Int[np.ndarray, " directions"]
    ids: tuple[str, ...]
    named: Bool[np.ndarray, " directions"]

    @cached_property
    def effects(self) -> set[str]:
        """Ids of the effects of which nothing is written."""
        return {self.ids[number] for number in np.unique(self.numbers[~self.named]).tolist()}

    def strongest(self, quantity: int, most: int) -> list[str]:
        """The effects that add most to the uncertainty of one quantity."""
        squares = self.shifts[quantity] ** 2 * np.diag(self.products) * ~self.named
        parts = np.bincount(self.numbers, squares, len(self.ids))
        return [self.ids[number] for number in np.argsort(-parts)[:most].tolist() if parts[number] > 0]


def of_every_sensor(id: str) -> bool:
    """Whether every sensor has this effect."""
    return id.partition(".")[0] in _OF_EVERY_SENSOR


def effect_directions(
    at: Tangent,
    groups: Sequence[tuple[Int[np.ndarray, " slots"], Visibilities]],
    entries: Catalogue,
    members: Sequence[Slot] = (),
) -> EffectDirections:
    """The directions of all effects of the model, those included that the nominal model absorbs.

    `groups`: the slots with equally many coefficients, and their visibility. `members`: those of the explanation.
    """
    slots = at.model.layout.slots
    # An effect that starts from several time constants counts once: as in the explanation, otherwise as it comes first.
    first = {slot.id: number for number, slot in reversed([*enumerate(slots)])}
    in_use = {slot.columns for slot in members}
    first |= {slot.id: number for number, slot in enumerate(slots) if slot.columns in in_use}
    taken = np.zeros(len(slots), bool)
    taken[[*first.values()]] = True
    steps, shown, owners = [np.zeros((0, len(at.vector)))], [np.zeros(0, bool)], list[int]()
    for numbers, group in groups:
        chosen = taken[numbers]
        columns = np.array([slots[number].columns for number in numbers[chosen].tolist()], int)
        columns = columns.reshape(-1, group.turned.shape[1])
        sizes = [_typical_sizes(at.model, slots[k], entries[slots[k].id]) for k in numbers[chosen].tolist()]
        block = np.zeros((*columns.shape, len(at.vector)))
        across = np.broadcast_to(columns[:, None], (*columns.shape, columns.shape[1]))
        np.put_along_axis(
            block, across, (np.reshape(sizes, columns.shape)[:, :, None] * group.turned[chosen]).mT, axis=2
        )
        steps.append(block.reshape(-1, len(at.vector)))
        shown.append(group.shown[chosen].ravel())
        owners += np.repeat(numbers[chosen], columns.shape[1]).tolist()
    ids = [slots[number].id for number in owners]
    places = {id: place for place, id in enumerate(dict.fromkeys(ids))}
    numbers = np.array([places[id] for id in ids], int)
    return EffectDirections(np.concatenate(steps), numbers, tuple(places), np.concatenate(shown))


def _typical_sizes(model: FullModel, slot: Slot, entry: Effect) -> list[float]:
    """The typical size of each coefficient in its scale. A change over a pause has another unit than its rate; its scale is its
    typical size."""
    return [
        entry.typical * factor(entry.unit, base) / float(model.scales[column]) if entry.shows(base) else 1.0
        for column, base in zip(slot.columns, slot.units, strict=False)
    ]


def included_orders(slots: Sequence[Slot], named: Sequence[Slot]) -> set[str]:
    """The effects that another one includes, as orders of one dependence on temperature: of a parameter with a named order all
    others, of any other parameter those of several orders."""
    followed = {slot.over_temperature for slot in named if slot.of_several_orders}
    included = {slot.id for slot in slots if slot.of_several_orders or slot.parameter_over_temperature in followed}
    return included - {slot.id for slot in named}
