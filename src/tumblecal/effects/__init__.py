"""The catalogue of effects: what can make the nominal chain wrong, one small entry each (DESIGN section 4)."""

from tumblecal.effects.catalogue import (
    Catalogue as Catalogue,
)
from tumblecal.effects.catalogue import (
    catalogue as catalogue,
)
from tumblecal.effects.catalogue import (
    entry as entry,
)
from tumblecal.effects.catalogue import (
    links as links,
)
from tumblecal.effects.effect import Effect as Effect
from tumblecal.effects.effect import OutputTerm as OutputTerm
from tumblecal.effects.effect import angle_effect as angle_effect
from tumblecal.effects.effect import output_effect as output_effect
from tumblecal.ground.axes import AXES as AXES
