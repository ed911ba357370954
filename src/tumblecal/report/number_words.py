"""Numbers of a test in words: p-values, differences of BIC, standard errors, and how ambiguous an ambiguous result is."""

import math
from collections.abc import Iterable

from tumblecal.diagnosis.tuning import SURE


# An explanation that many times as probable as the next is ahead of it.
_AHEAD = 2.0


def bic_words(delta: float) -> str:
    """A difference of BIC, by a decimal as long as that is short."""
    return f"{delta:.1f}" if abs(delta) < 1e5 else f"{delta:.3g}"


def probability_words(p_value: float, detected: bool) -> str:
    """A p-value in words."""
    if not detected and p_value < 0.05:
        return "somewhat unusual, but short of what would be called a contradiction."
    if not detected or p_value > 0.01:
        return "as expected when nothing is wrong."
    if p_value < 1e-6:
        return "data of a right model do not look like this."
    return f"a right model gives such data less often than once in {10 ** math.floor(-math.log10(p_value)):,.0f} measurements."


def ambiguity(probability: float, others: Iterable[float], *, alike: bool) -> str:
    """In which way several causes explain the same data.

    **Arguments:**

    - `probability`: of the leading explanation, `others`: of the rest. `alike`: whether some make the same signal as it.
    """
    if alike and probability >= SURE:
        return "causes that these positions cannot tell apart explain it"
    if probability > _AHEAD * max(others, default=0.0):
        return "one explanation is ahead of the others, but not surely right"
    return "several causes explain it about equally well"


def odds_words(log_odds: float) -> str:
    """`20 to 1`, from the logarithm of the odds."""
    return f"{math.exp(log_odds):.0f} to 1" if log_odds < math.log(1000) else "more than 1000 to 1"
