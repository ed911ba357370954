"""The catalogue of effects: what can make the nominal chain wrong, one small entry each (DESIGN section 4)."""

from tumblecal.effects.catalogue import (
    Catalogue as Catalogue,
    catalogue as catalogue,
    entry as entry,
    links as links,
    read_effects as read_effects,
)
from tumblecal.effects.effect import AXES as AXES, Effect as Effect, OutputTerm as OutputTerm, output_effect as output_effect
