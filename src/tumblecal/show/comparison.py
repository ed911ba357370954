"""A comparison of two calibrations for people."""

import math

from tumblecal.history.comparison import Comparison
from tumblecal.show.tables import Table
from tumblecal.show.words import words_of


def comparison_tables(comparison: Comparison) -> list[Table]:
    """The changes between two calibrations, and their tests."""
    words = words_of("comparison", c=comparison)
    return [table for name in ("changes", "tests") if (table := words.table(name))]


def dof_words(dof: float) -> str:
    """End of a sentence: the noise was estimated; "" if it was stated."""
    return f"; its noise was estimated from {dof:g} degree{'s' * (dof != 1)} of freedom" if math.isfinite(dof) else ""
