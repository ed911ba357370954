"""Formats of numbers in texts and tables: p-values, and a value with its uncertainty."""

import math
from collections.abc import Sequence


# Smaller p-values are shown as this bound.
_SMALLEST_P = 1e-100
# Decimals of a value without an uncertainty, in the unit in which it is shown.
_DECIMALS = 4


def p_words(p_value: float) -> str:
    """`p = 0.034`, `p = 3e-13`, or the bound `p < 1e-100`; never `p = 0`."""
    return f"p = {_p_digits(p_value)}" if p_value > _SMALLEST_P else f"p < {_SMALLEST_P:g}"


def p_cell(p_value: float | None) -> str:
    """A p-value in a table; "" if it does not exist."""
    if p_value is None or not math.isfinite(p_value):
        return ""
    return _p_digits(p_value) if p_value > _SMALLEST_P else f"<{_SMALLEST_P:g}"


def _p_digits(p_value: float) -> str:
    """Two significant digits, below 0.01 one."""
    return f"{p_value:.2g}" if p_value >= 0.01 else f"{p_value:.1g}"


def capped(value: float, form: str, most: float = 1000.0) -> str:
    """A number in this format, or the bound `> 1000` or `< -1000` if it is larger than that."""
    return format(value, form) if abs(value) <= most else f"{'> ' if value > 0 else '< -'}{most:g}"


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


def changed(before: float, after: float, u: float | None = None) -> str:
    """`0.141 -> 0.103` with equal decimals: those of the uncertainty of the change, or three digits of the smaller number."""
    places = decimals(min(abs(before), abs(after))) + 1 if u is None else decimals(u)
    return f"{with_decimals(before, places)} -> {with_decimals(after, places)}"


def counted(number: int, word: str) -> str:
    """`1 row`, `2 rows`, `2 stretches`."""
    ending = "es" if word.endswith("ch") else "s"
    return f"{number} {word}{'' if number == 1 else ending}"


def duration(seconds: float) -> str:
    """`90 s`, `5 min`, `2.5 h`, `3 d`."""
    for unit, size in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


def shortened(words: Sequence[str], most: int, joint: str = ", ", last: str = " and") -> str:
    """The first `most` words joined: `a, b`, or `a, b and 3 more`."""
    more = len(words) - most
    return joint.join(words[:most]) + (f"{last} {more} more" if more > 0 else "")


def number(value: float | None, digits: int = 3) -> str:
    """A number in a table; "" for one that does not exist."""
    return "" if value is None or not math.isfinite(value) else f"{value:.{digits}g}"
