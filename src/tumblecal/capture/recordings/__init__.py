"""Recordings made elsewhere, a format a file; a file put beside these is found, nothing else changes.

Each file of a format defines `READER`, a `Reader`: it recognises a source and gives its tables as they stand there. What
their columns mean, and in which unit, is settled once for all formats (`roles.py`, `sample_file.py`).
"""

from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from tumblecal.capture.recordings.damage import Damage
from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.capture.recordings.table import Reader, SourceTable
from tumblecal.capture.sniff import unknown_words
from tumblecal.ground.errors import InputError
from tumblecal.ground.suggested_command import EVERY, suggested
from tumblecal.ground.text_file import check_zero_bytes, no_text_words


_HEAD = 1 << 16


@cache
def readers() -> tuple[Reader, ...]:
    """All formats, found among the files of this folder; those that any file could be come last."""
    modules = (import_module(f"{__name__}.{module.name}") for module in iter_modules(__path__))
    return tuple(sorted((m.READER for m in modules if hasattr(m, "READER")), key=lambda reader: reader.rank))


def reader_of(path: Path) -> Reader | None:
    """The format of a source; None where none explains it.

    **Raises:** `InputError` for a source that is not there, cannot be read or is empty.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    head = _head(path) if path.is_file() else b""
    if path.is_file() and not head:
        raise InputError(f"{path}: the file is empty")
    return next((reader for reader in readers() if reader.recognises(path, head)), None)


def source_tables(
    path: Path, options: RecordingOptions = RecordingOptions(), damage: Damage | None = None
) -> tuple[Reader, list[SourceTable]]:
    """The format of a source, and the tables in it; what is damaged in them is reported.

    **Raises:** `InputError` for a source that no format explains, that is damaged, or whose library is not installed.
    """
    reader = reader_of(path)
    if reader is None:
        head = _head(path) if path.is_file() else b""
        if words := no_text_words(head):
            raise InputError(f"{path}: this is {words}")
        if (path / "journal.log").is_file():
            raise InputError(
                f"{path}: the folder of a capture; its bytes are a recording, {path / 'raw.log'}; without options of "
                f"recordings, its means are made by: {suggested('reduce', path, less=EVERY)}"
            )
        check_zero_bytes(path, head, "text")
        known = "; ".join(reader.title for reader in readers())
        words = f": {unknown_words(head)}" if head else ""
        raise InputError(f"{path}: no format explains it{words}. Read are {known}")
    return reader, reader.read(path, options, damage or Damage())


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(_HEAD)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
