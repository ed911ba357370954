"""The unit, the result and the stored files that a user names."""

from collections.abc import Sequence
from pathlib import Path

from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import shortened
from tumblecal.history.database import damaged_documents, documents
from tumblecal.history.entry import Entry


_SHOWN = 10


def require_named(database: Path, entries: Sequence[Entry], serial: str | None, number: int | None) -> None:
    """Check that a unit has results, and that a result is one of them.

    **Raises:** `InputError` with those that exist.
    """
    units = sorted({entry.serial for entry in entries if not entry.damaged} - {""})
    if serial is not None and serial not in units:
        raise InputError(
            f"{database}: no unit {serial}; units: {shortened(units, _SHOWN) or 'none with a serial number'}"
        )
    numbers = [entry.number for entry in entries if serial in (None, entry.serial)]
    if serial is not None and number is not None and number not in numbers:
        shown = shortened([*map(str, numbers)], _SHOWN)
        raise InputError(f"--files {number}: not a result of unit {serial}; its results are {shown}")


def stored_files(database: Path, number: int, out: Path | None) -> tuple[dict[str, str], str]:
    """The stored files of a result, and the names of damaged ones, which are not among them; `out`: their new folder.

    **Raises:** `InputError` for an unknown number, no folder, or a folder that has such files.
    """
    stored, damaged = documents(database, number), ", ".join(damaged_documents(database, number))
    if not stored:
        reason = (
            f"damaged in {database}: {damaged}; restore it from a copy" if damaged else f"{database} has no such files"
        )
        raise InputError(f"--files {number}: {reason}")
    if out is None:
        raise InputError(f"--files {number}: give a folder with --out")
    if existing := sorted(name for name in stored if (out / name).exists()):
        raise InputError(f"{out}: has {', '.join(existing)} already; give a different folder with --out")
    return stored, damaged
