"""The catalogue of effects: possible errors of the nominal chain, one entry each."""

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
