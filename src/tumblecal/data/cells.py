"""Cells of a table: numbers, labels, and their faults."""

import math
import re
from collections.abc import Sequence

from tumblecal.ground.plain_text import from_text
from tumblecal.ground.text_file import shown


# Larger numbers are not measurements, and would overflow the sums of squares.
LARGEST_NUMBER = 1e30
ABSOLUTE_ZERO_DEGC = -273.15
# Typographic minus signs; and blanks and apostrophes that separate thousands.
_MINUS, _THOUSANDS = dict.fromkeys(map(ord, "−–"), "-"), re.compile(r"(?<=\d)[ '’\u00a0\u202f](?=\d{3})")
_PLAIN = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
# Usual entries for a missing measurement.
_MISSING = r"-{1,3}|–|—|n/?a|none|null"
_SENSES = r"up|down|cw|ccw|[+-]|positive|negative|forward|backward"
# Remedies for cells that are not numbers: pattern of the cell, and of its column.
_CURES = {
    (_SENSES, "approach"): "write +1 or -1",
    (r"[\d.]*_[\d_.]*", ""): "write it without underscores",
    (_MISSING, ""): "measure the position again or remove the row",
    (r"([+-]?(?:\d+[.,]?\d*|[.,]\d+))\s*([^\W\d_]{1,4}|°[^\W\d_]?|%)", ""): "write {0}, without the unit {1}",
    (r".*\d\s*°\s*\d.*", ""): "write degrees with decimals, such as 45.5 for 45°30'",
    (r"[+-]?\d+([:\s]\s*[\d.]+)+", "(alpha|beta)_deg"): "write degrees with decimals, such as 45.5 for 45°30'",
    (
        r".*(\d:\d\d|\d{4}-\d\d-\d\d|\d\.\d\d?\.\d{4}|\d/\d\d?/\d).*",
        "",
    ): "write a number, such as the seconds since the first position",
    (r"[+-]?[\d.,]*\d[\d.,]*", ""): "use a decimal point, and separate no thousands",
}
_WHOLE = re.compile(r"\d+(\.0+)?")


def number_in(cell: object, column: str = "") -> tuple[float, str]:
    """The finite number in a cell of a column and ""; or NaN and the fault of the cell."""
    if isinstance(cell, str):
        cell = cell.strip()
    if cell is None or cell == "":
        return math.nan, "the cell is empty; write a number, or remove the row or the whole column"
    try:
        # Python would read 10_00 as 1000.
        value = None if isinstance(cell, str) and "_" in cell else float(cell)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        value = None
    if value is None:
        missing = column != "approach" and re.fullmatch(_MISSING, str(cell), re.IGNORECASE)
        return (
            math.nan,
            f"{shown(cell)} is {'a missing reading' if missing else 'not a number'}; {advice(cell, column)}",
        )
    if not math.isfinite(value):
        return math.nan, f"{shown(cell)} is not a finite number; measure the position again or remove the row"
    return value, ""


def advice(cell: object, column: str = "") -> str:
    """Remedy for a cell that is not a number."""
    text = cell.strip() if isinstance(cell, str) else ""
    plain = _THOUSANDS.sub("", text.translate(_MINUS))
    if _PLAIN.fullmatch(plain):
        return f"write {plain}"
    for (pattern, columns), cure in _CURES.items():
        found = re.fullmatch(pattern, text, re.IGNORECASE)
        if found and re.fullmatch(columns or ".*", column):
            return cure.format(*found.groups())
    return "write one"


def beyond_words(name: str, value: float) -> str:
    """Fault of a number as a value of a column; "" if it is possible."""
    if abs(value) > LARGEST_NUMBER:
        return f"{value:.3g} is not a possible value; correct it or remove the row"
    if name == "temperature_degc" and value < ABSOLUTE_ZERO_DEGC:
        return f"{value:.6g} degC is below absolute zero; correct it or remove the row"
    return ""


def labels_in(cells: Sequence[object]) -> list[str]:
    """Labels without leading and trailing blanks; "" for an empty cell.

    An integer in a column of floats (1.0) becomes 1; also in a column of texts that are all integers, in both spellings.
    """
    labels = [_label(cell) for cell in cells]
    spellings = set(labels) - {""}
    whole = {label: label.partition(".")[0] for label in spellings if _WHOLE.fullmatch(label)}
    twice = len(whole) == len(spellings) > len(set(whole.values()))
    return [whole.get(label, label) for label in labels] if twice else labels


def _label(cell: object) -> str:
    if isinstance(cell, float):
        return "" if math.isnan(cell) else str(int(cell)) if cell.is_integer() else str(cell)
    return "" if cell is None else from_text(" ".join(str(cell).strip().splitlines()))
