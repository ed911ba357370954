"""The list of the entries of a history; without numpy, so that a long list is printed at once."""

from collections.abc import Iterable

from tumblecal.ground.numbers_shown import p_cell
from tumblecal.history.entry import Entry
from tumblecal.show.tables import Table, number


def listed(entries: Iterable[Entry]) -> Table:
    """The entries of a history, a row each."""
    header = ["number", "date (UTC)", "serial number", "kind", "rms / mg", "p", "outcome"]
    return Table(header, list(map(_row, entries)))


def _row(entry: Entry) -> list[str]:
    date = entry.date_utc[:16].replace("T", " ")
    if entry.damaged:
        return [str(entry.number), date, "", "", "", "", f"damaged: {entry.damaged}"]
    rms = None if entry.rms_g is None else entry.rms_g * 1e3
    return [str(entry.number), date, entry.serial, entry.kind, number(rms), p_cell(entry.p_value), entry.outcome]
