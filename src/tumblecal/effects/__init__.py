"""The catalogue of effects: possible errors of the nominal chain, one entry each.

`Catalogue` is the type of a catalogue, a `dict` of `Effect` by id; `AXES` are the names of the axes.

Examples:
    >>> from tumblecal.effects import AXES, Catalogue, catalogue
    >>> nonlinear: Catalogue = {id: effect for id, effect in catalogue().items() if id.startswith("second_order")}
    >>> list(nonlinear) == [f"second_order.{axis}" for axis in AXES]
    True
"""

from tumblecal.effects.added_terms import OutputTerm, angle_effect, output_effect
from tumblecal.effects.catalogue import Catalogue, catalogue, entry, links, with_effects
from tumblecal.effects.effect import Effect
from tumblecal.ground.axes import AXES


__all__ = [
    "AXES",
    "Catalogue",
    "Effect",
    "OutputTerm",
    "angle_effect",
    "catalogue",
    "entry",
    "links",
    "output_effect",
    "with_effects",
]
