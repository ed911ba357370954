"""White signals of the effects of the catalogue, each direction of its coefficients at the effect's typical size."""

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


class EffectSignals(NamedTuple):
    """`rows`: a white signal for each direction of the coefficients. `numbers`: whose each is among `ids`. `shown`: whether the
    residuals of the nominal model can show the direction."""

    __repr__ = brief

    rows: Float[np.ndarray, "directions rows"]
    numbers: Int[np.ndarray, " directions"]
    ids: tuple[str, ...]
    shown: Bool[np.ndarray, " directions"]


def signals_at_typical_size(
    screened: Screened, entries: Catalogue, named: Collection[str], *, absorbed: bool = False
) -> EffectSignals:
    """The signals of all effects without the named ones.

    **Arguments:**

    - `absorbed`: whether the directions that the nominal model absorbs are included.
    """
    at, seen, slots = screened.at, screened.seen, screened.at.model.layout.slots
    # An effect that starts from several time constants counts once.
    first = {slot.id: number for number, slot in reversed([*enumerate(slots)]) if slot.id not in named}
    taken = np.zeros(len(slots), bool)
    taken[list(first.values())] = True
    rows, visible, owners = [np.zeros((0, len(at.jacobian)))], [np.zeros(0, bool)], list[str]()
    for numbers, group in seen.groups:
        chosen = taken[numbers] & (absorbed | group.shown.any(axis=1))
        shown, own = group.shown[chosen], [slots[number] for number in numbers[chosen].tolist()]
        columns = np.array([slot.columns for slot in own], int).reshape(len(own), group.turned.shape[1])
        sizes = np.array([_typical_sizes(at.model, slot, entries[slot.id]) for slot in own]).reshape(columns.shape)
        directions = group.turned[chosen].mT @ (sizes[:, :, None] * at.varying.T[columns])
        wanted = np.ones_like(shown) if absorbed else shown
        rows.append(directions[wanted])
        visible.append(shown[wanted])
        owners += np.repeat([slot.id for slot in own], wanted.sum(axis=1)).tolist()
    ids = tuple(dict.fromkeys(owners))
    places = {id: number for number, id in enumerate(ids)}
    numbers = np.array([places[id] for id in owners], int)
    return EffectSignals(np.concatenate(rows), numbers, ids, np.concatenate(visible))


def _typical_sizes(model: FullModel, slot: Slot, entry: Effect) -> list[float]:
    """The typical size of each coefficient in its scale. A change over a pause has another unit than its rate; its scale is its
    typical size."""
    return [
        entry.typical * factor(entry.unit, base) / float(model.scales[column]) if entry.shows(base) else 1.0
        for column, base in zip(slot.columns, slot.units, strict=False)
    ]
