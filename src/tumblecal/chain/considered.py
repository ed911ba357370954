"""Inputs of an uncertainty budget as files state them: quantities that are neither fitted nor exactly known."""

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from tumblecal.ground.strict_toml import Line, Number, Strict


# Standard uncertainty of a distribution of half width 1 (JCGM 100, 4.3).
_HALF_WIDTH = {"rectangular": 1 / math.sqrt(3), "triangular": 1 / math.sqrt(6), "arcsine": 1 / math.sqrt(2)}
Positive = Annotated[Number, Field(gt=0)]
# 0.5 means a relative uncertainty of the size of 100 % (JCGM 100, G.4.2); for fewer, coverage factors diverge.
Freedom = Annotated[Number, Field(ge=0.5)]


class Considered(Strict):
    """An input: its kind, its size with a distribution, and the source of the size.

    `what` is an effect of the catalogue (without its axis: of all three, independently), a fixed leaf of the chain,
    `spindle_angle`, `pitch_angle` or `reading`; alternatively `adds_to` names the fitted parameters to which it is
    added. `size` is the half width; for a normal distribution it is the expanded uncertainty with the factor
    `coverage`. `per`: a separate value for each position, pitch setting, run or mounting. `dof`: degrees of freedom
    of the size, None for infinitely many.
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
            raise ValueError("coverage applies only to a normal distribution; other sizes are half widths")
        if self.adds_to and self.per:
            raise ValueError("per applies only to what, not to adds_to")
        return self

    @property
    def standard(self) -> float:
        """The standard uncertainty in units of `size`."""
        return _HALF_WIDTH.get(self.distribution, 1 / self.coverage)

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the size."""
        return math.inf if self.dof is None else self.dof
