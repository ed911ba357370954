"""The list of the entries of a history, and damage; without numpy, so that a long list is printed at once."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from tumblecal.ground.numbers_shown import counted, number, p_cell
from tumblecal.ground.suggested_command import suggested
from tumblecal.history.entry import Entry
from tumblecal.show.tables import Table


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


def list_text(database: Path, entries: Sequence[Entry]) -> str:
    """The entries of a history, their number, and the command for one unit."""
    serials = [entry.serial for entry in entries if not entry.damaged]
    named, nameless = [serial for serial in serials if serial], serials.count("")
    of_units = [f"{counted(len(named), 'result')} of {counted(len({*named}), 'unit')}"] if named else []
    if nameless:
        of_units.append(
            f"{counted(nameless, 'result')} without a serial number (no unit; state `# serial_number:` in the data)"
        )
    count = "; ".join(of_units) or "no results"
    return f"{listed(entries)}\n{count}; one unit: {suggested('history', database, 'SERIAL')}"


def damage_lines(entries: Iterable[Entry], words: str = "") -> Iterator[str]:
    """A line for each damaged entry, by number and, if it is known, date; `words`: on the consequence."""
    for entry in entries:
        if entry.damaged:
            date = f" of {entry.date_utc[:10]}" if entry.date_utc else ""
            yield f"result {entry.number}{date}{words}: {entry.damaged}"
