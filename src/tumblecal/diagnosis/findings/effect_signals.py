"""Directions of the coefficients of the catalogue's effects, each of the effect's typical size."""

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.diagnosis.model.full_model import FullModel
from tumblecal.diagnosis.model.layout import Slot
from tumblecal.diagnosis.screening.screened import Screened
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


def directions_at_typical_size(
    screened: Screened, entries: Catalogue, without: Collection[str], *, absorbed: bool = False
) -> EffectDirections:
    """The directions of all effects of the model, `without` some.

    **Arguments:**

    - `absorbed`: whether the directions that the nominal model absorbs are included.
    """
    at, seen, slots = screened.at, screened.seen, screened.at.model.layout.slots
    # An effect that starts from several time constants counts once: as it is in the explanation, else as it comes first.
    first = {slot.id: number for number, slot in reversed([*enumerate(slots)]) if slot.id not in without}
    in_use = {cause.slot.columns for cause in screened.members}
    first |= {slot.id: number for number, slot in enumerate(slots) if slot.columns in in_use and slot.id in first}
    taken = np.zeros(len(slots), bool)
    taken[list(first.values())] = True
    steps, shown, owners = [np.zeros((0, len(at.vector)))], [np.zeros(0, bool)], list[str]()
    for numbers, group in seen.groups:
        chosen = taken[numbers] & (absorbed | group.shown.any(axis=1))
        visible, own = group.shown[chosen], [slots[number] for number in numbers[chosen].tolist()]
        columns = np.array([slot.columns for slot in own], int).reshape(len(own), group.turned.shape[1])
        sizes = np.array([_typical_sizes(at.model, slot, entries[slot.id]) for slot in own]).reshape(columns.shape)
        block = np.zeros((*columns.shape, len(at.vector)))
        np.put_along_axis(
            block,
            np.broadcast_to(columns[:, None, :], (*columns.shape, columns.shape[1])),
            (sizes[:, :, None] * group.turned[chosen]).mT,
            axis=2,
        )
        wanted = np.ones_like(visible) if absorbed else visible
        steps.append(block[wanted])
        shown.append(visible[wanted])
        owners += np.repeat([slot.id for slot in own], wanted.sum(axis=1)).tolist()
    ids = tuple(dict.fromkeys(owners))
    places = {id: number for number, id in enumerate(ids)}
    numbers = np.array([places[id] for id in owners], int)
    return EffectDirections(np.concatenate(steps), numbers, ids, np.concatenate(shown))


def _typical_sizes(model: FullModel, slot: Slot, entry: Effect) -> list[float]:
    """The typical size of each coefficient in its scale. A change over a pause has another unit than its rate; its scale is its
    typical size."""
    return [
        entry.typical * factor(entry.unit, base) / float(model.scales[column]) if entry.shows(base) else 1.0
        for column, base in zip(slot.columns, slot.units, strict=False)
    ]
