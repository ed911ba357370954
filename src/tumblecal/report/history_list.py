"""Tables of text, and the list of the entries of a history; without numpy, so that a long list is printed at once."""

import math
from collections.abc import Iterable, Sequence

from tumblecal.ground.numbers_shown import p_cell
from tumblecal.history.entry import Entry


Row = list[str]
LISTED = ["number", "date (UTC)", "serial number", "kind", "rms / mg", "p", "outcome"]


def table_text(header: Row, rows: Iterable[Row], text: Sequence[int] = ()) -> str:
    """A table for a terminal; `text`: the columns of words, which are left-aligned."""
    lines = [header, *rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(header))]
    return "\n".join(_aligned(line, widths, text) for line in lines)


def _aligned(line: Row, widths: Sequence[int], text: Sequence[int]) -> str:
    cells = zip(line, widths, strict=True)
    return "  ".join(c.ljust(width) if k in text else c.rjust(width) for k, (c, width) in enumerate(cells)).rstrip()


def number(value: float | None, digits: int = 3) -> str:
    """A number in a table; "" for one that does not exist."""
    return "" if value is None or not math.isfinite(value) else f"{value:.{digits}g}"


def listed_row(entry: Entry) -> Row:
    """An entry in the list."""
    if entry.damaged:
        date = entry.date_utc[:16].replace("T", " ")
        return [str(entry.number), date, "", "", "", "", f"damaged: {entry.damaged}"]
    rms = None if entry.rms_g is None else entry.rms_g * 1e3
    date = entry.date_utc[:16].replace("T", " ")
    return [str(entry.number), date, entry.serial, entry.kind, number(rms), p_cell(entry.p_value), entry.outcome]
