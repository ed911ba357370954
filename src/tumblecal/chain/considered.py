"""What is not fitted but not exactly known either, as files state it: an input of an uncertainty budget."""

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from tumblecal.ground.strict_toml import Line, Number, Strict


# Standard uncertainty of a distribution of half width 1 (JCGM 100, 4.3).
_HALF_WIDTH = {"rectangular": 1 / math.sqrt(3), "triangular": 1 / math.sqrt(6), "arcsine": 1 / math.sqrt(2)}
Positive = Annotated[Number, Field(gt=0)]
# Half is a size that is known to 100 % of itself (JCGM 100, G.4.2); coverage factors of fewer run away.
Freedom = Annotated[Number, Field(ge=0.5)]


class Considered(Strict):
    """An input: what it is, its size with its distribution, and where the size is from.

    `what` is an effect of the catalogue (without its axis: of all three, independently), a leaf of the chain that is kept,
    `spindle_angle`, `pitch_angle` or `reading`; `adds_to` instead names fitted parameters that it is added to. `size` is the
    half width, of a normal distribution the expanded uncertainty with `coverage`. `per`: each position (pitch setting, run,
    mounting) has its own. `dof`: degrees of freedom of the size, None for infinitely many.
    """

    what: Line = ""
    adds_to: Line = ""
    size: Line
    distribution: Literal["normal", "rectangular", "triangular", "arcsine"] = "normal"
    coverage: Positive = 1.0
    dof: Freedom | None = None
    per: Literal["position", "pitch", "run", "mount"] | None = None
    source: Line = ""

    @model_validator(mode="after")
    def _one_place(self) -> "Considered":
        if bool(self.what) == bool(self.adds_to):
            raise ValueError("give either what (an effect, a leaf) or adds_to (fitted parameters)")
        if self.coverage != 1.0 and self.distribution != "normal":
            raise ValueError("coverage goes with a normal distribution; other sizes are half widths")
        if self.adds_to and self.per:
            raise ValueError("per goes with what")
        return self

    @property
    def standard(self) -> float:
        """The standard uncertainty in units of `size`."""
        return _HALF_WIDTH.get(self.distribution, 1 / self.coverage)

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the size."""
        return math.inf if self.dof is None else self.dof
