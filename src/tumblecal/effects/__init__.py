"""The catalogue of effects: what can make the nominal chain wrong, one small entry each (DESIGN section 4)."""

from tumblecal.effects.catalogue import Catalogue, catalogue, entry, links
from tumblecal.effects.effect import Effect, OutputTerm, angle_effect, output_effect
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
]
