"""Text that a terminal, a page, an XML file or a spreadsheet would execute instead of showing it.

Files written by users are rejected if they contain a control character. Text of devices and recordings is stored with escapes
instead. Line feeds, returns and tabs are allowed. Cells of CSV files that a spreadsheet would take for a formula are written
with an apostrophe, and read without it (https://owasp.org/www-community/attacks/CSV_Injection).
"""

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING

from tumblecal.ground.errors import one_line


if TYPE_CHECKING:
    import polars as pl

# C0, DEL and C1; marks of text direction (Unicode TR 9) and line separators; halves of surrogates; and characters that XML
# does not allow.
_RANGES = (
    *((0x00, 0x08), (0x0B, 0x0C), (0x0E, 0x1F), (0x7F, 0x9F), (0x061C, 0x061C), (0x200E, 0x200F), (0x2028, 0x202E)),
    *((0x2066, 0x2069), (0xD800, 0xDFFF), (0xFEFF, 0xFEFF), (0xFFFE, 0xFFFF)),
)
_CONTROL = re.compile("[" + "".join(f"{chr(first)}-{chr(last)}" for first, last in _RANGES) + "]")
_HARMLESS = bytes([0x09, 0x0A, 0x0D, *range(0x20, 0x7F)])
# The same for regular expressions of Polars.
CONTROLS = "[" + "".join(f"\\x{{{first:x}}}-\\x{{{last:x}}}" for first, last in _RANGES if first != 0xD800) + "]"
# The beginning of a formula, unless the cell is a number; and as it is written.
_FORMULA, _WRITTEN = r"^[=+\-@\t]", r"^'([=+\-@\t])"


def plain(text: str) -> str:
    """A text with escapes such as `\\x1b` in place of its control characters."""
    return text if first_control(text) is None else _CONTROL.sub(lambda found: one_line(found[0]), text)


def first_control(text: str) -> int | None:
    """Index of the first control character of a text; None if there is none."""
    if text.isascii() and not text.encode("ascii").translate(None, _HARMLESS):
        return None  # fast path for large tables
    found = _CONTROL.search(text)
    return found.start() if found else None


def controls_in(content: object, at: str = "") -> Iterator[str]:
    """Dotted paths of the texts and keys with control characters in the content of a JSON or TOML file."""
    if isinstance(content, dict | list):
        parts = content.items() if isinstance(content, dict) else enumerate(content)
        for key, part in parts:
            path = f"{at}.{key}" if at else str(key)
            if isinstance(key, str) and first_control(key) is not None:
                yield path
            yield from controls_in(part, path)
    elif isinstance(content, str) and first_control(content) is not None:
        yield at


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
