"""Cells of a table: numbers, labels, and their faults."""

import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from tumblecal.ground.plain_text import from_text
from tumblecal.ground.text_file import shown


if TYPE_CHECKING:
    import polars as pl


# Larger numbers are not measurements, and would overflow the sums of squares.
LARGEST_NUMBER = 1e30
ABSOLUTE_ZERO_DEGC = -273.15
_WITH_UNIT = re.compile(r"([+-]?(?:\d+[.,]?\d*|[.,]\d+))\s*([^\W\d_]{1,4}|°[^\W\d_]?|%)")
_PLAIN = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_MINUS = dict.fromkeys(map(ord, "−–"), "-")
_SENSES = ("up", "down", "cw", "ccw", "+", "-", "positive", "negative", "forward", "backward")
# Usual entries for a missing measurement.
_MISSING = ("-", "--", "---", "–", "—", "n/a", "na", "none", "null")
_ANGLES = ("alpha_deg", "beta_deg")
_WHOLE = re.compile(r"\d+(\.0+)?")


def number_in(cell: object, column: str = "") -> tuple[float, str]:
    """The finite number in a cell of a column and ""; or NaN and the fault of the cell."""
    if isinstance(cell, str):
        cell = cell.strip()
    if cell is None or cell == "":
        return math.nan, "the cell is empty; write a number or remove the whole column"
    # Python would read 10_00 as 1000.
    underscored = isinstance(cell, str) and "_" in cell
    try:
        value = math.nan if underscored else float(cell)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        underscored, value = False, None
    if underscored or value is None:
        what = "a missing reading" if _is_missing(cell, column) else "not a number"
        return math.nan, f"{shown(cell)} is {what}; {advice(cell, column)}"
    if not math.isfinite(value):
        return math.nan, f"{shown(cell)} is not a finite number; measure the position again or remove the row"
    return value, ""


def advice(cell: object, column: str = "") -> str:
    """Remedy for a cell that is not a number."""
    text = cell.strip() if isinstance(cell, str) else ""
    if "_" in text and re.fullmatch(r"[\d_.]+", text):
        return "write it without underscores"
    if _is_missing(text, column):
        return "measure the position again or remove the row"
    return unit_advice(text) or _sign_advice(text) or _kind_advice(text, column) or mark_advice(text) or "write one"


def _is_missing(cell: object, column: str) -> bool:
    """Whether a cell marks a missing measurement."""
    return isinstance(cell, str) and column != "approach" and cell.lower() in _MISSING


def _sign_advice(text: str) -> str:
    """Remedy for a number with a typographic minus, or with thousands separated by blanks or apostrophes."""
    plain = re.sub(r"(?<=\d)[ '’\u00a0\u202f](?=\d{3})", "", text.translate(_MINUS))
    return f"write {plain}" if plain != text and _PLAIN.fullmatch(plain) else ""


def _kind_advice(text: str, column: str) -> str:
    """Remedy for angles in minutes, for times and dates, and for words of a sense of rotation."""
    if re.search(r"\d\s*°\s*\d", text) or (column in _ANGLES and re.fullmatch(r"[+-]?\d+([:\s]\s*[\d.]+)+", text)):
        return "write degrees with decimals, such as 45.5 for 45°30'"
    if re.search(r"\d:\d\d|\d{4}-\d\d-\d\d|\d\.\d\d?\.\d{4}|\d/\d\d?/\d", text):
        return "write a number, such as the seconds since the first position"
    return "write +1 or -1" if column == "approach" and text.lower() in _SENSES else ""


def unit_advice(text: str) -> str:
    """Remedy for a number with a unit; "" for other texts."""
    match = _WITH_UNIT.fullmatch(text.strip())
    return f"write {match[1]}, without the unit {match[2]}" if match else ""


def mark_advice(text: str) -> str:
    """Remedy for a number with another decimal mark, or with separated thousands; "" for other texts."""
    return (
        "use a decimal point, and separate no thousands" if re.fullmatch(r"[+-]?[\d.,]*\d[\d.,]*", text.strip()) else ""
    )


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


def is_empty(column: "pl.Series") -> bool:
    """Whether all cells of a column are empty."""
    import polars as pl

    if column.dtype == pl.String:
        return bool((column.str.strip_chars().fill_null("") == "").all())
    return not len(column.drop_nulls().drop_nans() if column.dtype.is_float() else column.drop_nulls())
