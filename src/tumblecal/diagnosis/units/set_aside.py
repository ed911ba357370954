"""Exclusions: units that are too few to decide for all, and effects of a size that no head has."""

import numpy as np

from tumblecal.chain.head_file import MeasuredHead
from tumblecal.diagnosis.units.joint import SharedExplanation
from tumblecal.diagnosis.units.unit import OwnCauses, Unit
from tumblecal.effects.effect import of_head


# A coefficient is too large when it is so by this many of its standard deviations, as in one file.
_SURE_SD = 2.0
# Of so many units one may be set aside: the rest must be able to outvote it.
_UNITS_FOR_EACH = 3


def most_aside(units: int) -> int:
    """How many units may be excluded from the results of the head: fewer than a third."""
    return (units - 1) // _UNITS_FOR_EACH


def has_head_of_its_own(unit: Unit, own: OwnCauses) -> bool:
    """Whether a unit needs an error of the head that is its alone."""
    return len(not_of_the_head(unit, own).members) < len(own.members)


def not_of_the_head(unit: Unit, own: OwnCauses) -> OwnCauses:
    """The causes of a unit without errors of the head."""
    listed = ((k, unit.pool.causes[k].slot) for k in own.members)
    return own._replace(members=tuple(k for k, slot in listed if not (slot.columns and of_head(slot.links))))


def impossible_effects(told: SharedExplanation, head: MeasuredHead | None) -> frozenset[str]:
    """Ids of the effects of an explanation that would need coefficients such as no head has (`Effect.largest`), common to all
    units or scattered over them."""
    weighed, impossible = told.weighed, set[str]()
    sizes = dict(zip(head.names, np.abs(head.values) - _SURE_SD * head.sd, strict=True)) if head is not None else {}
    for signal in (weighed.signals[k] for k in told.told.members):
        if any(sizes.get(name, 0.0) > signal.slot.largest for name in signal.slot.names):
            impossible.add(signal.label)
    for spread in weighed.spreads:
        if spread.tau * max(spread.signal.scales) > spread.signal.slot.largest:
            impossible.add(spread.signal.label)
    return frozenset(impossible)
