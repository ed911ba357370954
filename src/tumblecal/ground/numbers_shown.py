"""Numbers as texts and tables show them: p-values, and a value with its uncertainty."""

import math


# Smaller p-values are given as this bound.
_SMALLEST_P = 1e-100


def p_words(p_value: float) -> str:
    """`p = 0.03`, or the bound `p < 1e-100`; never `p = 0`."""
    return f"p = {p_value:.2g}" if p_value > _SMALLEST_P else f"p < {_SMALLEST_P:g}"


def p_cell(p_value: float | None) -> str:
    """A p-value in a table; nothing for one that does not exist."""
    if p_value is None or not math.isfinite(p_value):
        return ""
    return f"{p_value:.3g}" if p_value > _SMALLEST_P else f"<{_SMALLEST_P:g}"


def rounded_together(value: float, sd: float) -> str:
    """`0.201 +- 0.013`: the uncertainty to two significant digits, the value to the same place (GUM 7.2.6)."""
    places = max(0, 1 - math.floor(math.log10(sd))) if sd > 0 else 4
    return f"{value:z.{places}f} +- {sd:.{places}f}"
