"""Decimal marks: in a table that is not separated by commas a comma is decimal; thousands are not separated."""

import re
from typing import TYPE_CHECKING


if TYPE_CHECKING:
    import polars as pl

NUMBER = re.compile(r"[+-]?(?:\d+(?:[.,]\d+|\.)?|[.,]\d+)(?:[eE][+-]?\d+)?|nan", re.IGNORECASE)
# A number with a decimal comma, in two parts.
DECIMAL_COMMA = r"^\s*([+-]?\d*),(\d+(?:[eE][+-]?\d+)?)\s*$"
_COMMA = re.compile(DECIMAL_COMMA)


def has_decimal_comma(cell: object) -> bool:
    """Whether a cell is a number with a decimal comma."""
    return isinstance(cell, str) and bool(_COMMA.match(cell))


def pointed(cell: str) -> str:
    """A number with a decimal comma, with a point in its place; other cells are unchanged."""
    return _COMMA.sub(r"\1.\2", cell)


def without_decimal_comma(option: str) -> str:
    """An option with points in place of commas between digits, which separate no numbers there."""
    return re.sub(r"(?<=\d),(?=\d)", ".", option)


def number_of(column: "pl.Series", *, commas: bool) -> "pl.Series":
    """The numbers of a column of text, with decimal commas or points; null for other cells."""
    import polars as pl

    text = column.str.strip_chars().str.strip_chars_start("+")
    if commas:
        text = text.str.replace(r"^[^.]*\..*$", "").str.replace(",", ".", literal=True)
    return text.cast(pl.Float64, strict=False)
