"""Directions of the coefficients of the catalogue's effects, each of the effect's typical size."""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.causes.visibility import Visibilities
from tumblecal.diagnosis.model.full_model import FullModel
from tumblecal.diagnosis.model.layout import Slot
from tumblecal.diagnosis.model.tangent import Tangent
from tumblecal.effects import Catalogue, Effect
from tumblecal.ground.showing import brief
from tumblecal.ground.units import factor


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


def effect_directions(
    at: Tangent,
    groups: Sequence[tuple[Int[np.ndarray, " slots"], Visibilities]],
    entries: Catalogue,
    members: Sequence[Cause] = (),
) -> EffectDirections:
    """The directions of all effects of the model, those included that the nominal model absorbs.

    `groups`: the slots with equally many coefficients, and their visibility. `members`: the causes of the explanation.
    """
    slots = at.model.layout.slots
    # An effect that starts from several time constants counts once: as in the explanation, otherwise as it comes first.
    first = {slot.id: number for number, slot in reversed([*enumerate(slots)])}
    in_use = {cause.slot.columns for cause in members}
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
