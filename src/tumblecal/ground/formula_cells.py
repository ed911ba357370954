"""Cells of text in CSV files that a spreadsheet would execute as a formula: written with an apostrophe, read without it.

https://owasp.org/www-community/attacks/CSV_Injection
"""

import re
from typing import TYPE_CHECKING


if TYPE_CHECKING:
    import polars as pl

# The beginning of such a cell, unless the cell is a number; and as it is written.
_FORMULA, _WRITTEN = r"^[=+\-@\t]", r"^'([=+\-@\t])"


def as_text(cell: str) -> str:
    """A cell as it is written; numbers are unchanged."""
    if not re.match(_FORMULA, cell):
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell


def from_text(cell: str) -> str:
    """A cell as it was before `as_text`."""
    return re.sub(_WRITTEN, r"\1", cell)


def all_as_text() -> "pl.Expr":
    """`as_text` of all columns of text of a table."""
    import polars as pl

    words = pl.col(pl.String)
    formula = words.str.contains(_FORMULA) & words.cast(float, strict=False).is_null()
    return pl.when(formula).then("'" + words).otherwise(words).name.keep()


def column_from_text(column: "pl.Expr") -> "pl.Expr":
    """`from_text` of a column of text."""
    return column.str.replace(_WRITTEN, "${1}")
