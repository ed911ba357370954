"""Results of a test in words: p-values, odds, and the kind of an ambiguity."""

import math
from collections.abc import Iterable

from tumblecal.diagnosis.tuning import SURE


# An explanation that is this many times as probable as the next is the more probable one.
_AHEAD = 2.0


def probability_words(p_value: float, detected: bool) -> str:
    """A p-value in words."""
    if not detected and p_value < 0.05:
        return "unusual, but the nominal model is not rejected."
    if not detected or p_value > 0.01:
        return "consistent with the nominal model."
    if p_value < 1e-6:
        return "the nominal model is rejected."
    return (
        "the nominal model is rejected; a correct model would produce such data in fewer than 1 of "
        f"{10 ** math.floor(-math.log10(p_value)):,.0f} measurements."
    )


def ambiguity(probability: float, others: Iterable[float], *, indistinguishable: bool) -> str:
    """The kind of an ambiguity between several causes.

    **Arguments:**

    - `probability`: of the leading explanation, `others`: of the rest. `indistinguishable`: whether some
      produce the same signal.
    """
    if indistinguishable and probability >= SURE:
        return "several causes fit equally well and cannot be distinguished with these positions"
    if probability > _AHEAD * max(others, default=0.0):
        return "one explanation is more probable than the others, but not conclusive"
    return "several causes explain it almost equally well"


def odds_words(log_odds: float) -> str:
    """`20 to 1`, from the logarithm of the odds."""
    return f"{math.exp(log_odds):.0f} to 1" if log_odds < math.log(1000) else "more than 1000 to 1"
