"""A comparison of two calibrations for people."""

import math

from tumblecal.history.comparison import Comparison
from tumblecal.show.words import words_of


def comparison_text(comparison: Comparison) -> str:
    """The changes between two calibrations, for a terminal."""
    words = words_of("comparison", c=comparison)
    return f"{words.table('changes')}\n\n{words.table('tests')}"


def dof_words(dof: float) -> str:
    """End of a sentence: the noise was estimated; "" if it was stated."""
    return f"; its noise was estimated from {dof:g} degree{'s' * (dof != 1)} of freedom" if math.isfinite(dof) else ""
