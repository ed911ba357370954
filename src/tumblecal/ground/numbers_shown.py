"""Numbers as texts and tables show them: p-values, and a value with its uncertainty."""

import math


# Smaller p-values are given as this bound.
_SMALLEST_P = 1e-100
# Decimals of a value without an uncertainty, in the unit in which it is shown.
_DECIMALS = 4


def p_words(p_value: float) -> str:
    """`p = 0.03`, or the bound `p < 1e-100`; never `p = 0`."""
    return f"p = {p_value:.2g}" if p_value > _SMALLEST_P else f"p < {_SMALLEST_P:g}"


def p_cell(p_value: float | None) -> str:
    """A p-value in a table; nothing for one that does not exist."""
    if p_value is None or not math.isfinite(p_value):
        return ""
    return f"{p_value:.3g}" if p_value > _SMALLEST_P else f"<{_SMALLEST_P:g}"


def decimals(u: float) -> int:
    """Decimals with which an uncertainty has two significant digits; negative from 100 on."""
    if not (u > 0 and math.isfinite(u)):
        return _DECIMALS
    return 1 - int(f"{u:.1e}".partition("e")[2])


def with_decimals(value: float, places: int) -> str:
    """A value rounded to so many decimals, which may be negative; never `-0`."""
    return f"{round(value, places):z.{max(places, 0)}f}"


def rounded(value: float, *uncertainties: float) -> list[str]:
    """A value and its uncertainties: the first with two significant digits, all others to the same decimal (GUM 7.2.6)."""
    places = decimals(uncertainties[0])
    return [with_decimals(number, places) for number in (value, *uncertainties)]


def rounded_together(value: float, u: float) -> str:
    """`0.201 +- 0.013`: rounded as by `rounded`."""
    return " +- ".join(rounded(value, u))
