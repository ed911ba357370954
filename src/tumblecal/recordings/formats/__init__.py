"""The formats of recordings, a module for each; a new module in this folder is found automatically.

Each module of a format defines `READER`, a `Reader`: it recognises a source and returns its tables under their own names.
The quantities and units of columns are determined by the same code for all formats (`recordings.columns`).
"""

from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from tumblecal.capture.decoding.sniff import unknown_words
from tumblecal.ground.errors import InputError
from tumblecal.ground.suggested_command import EVERY, suggested
from tumblecal.ground.text_file import check_zero_bytes, no_text_words
from tumblecal.recordings.damage import Damage
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.table import Reader, Source, Table


_HEAD = 1 << 16


@cache
def readers() -> tuple[Reader, ...]:
    """All formats, found among the modules of this folder. Formats that accept almost any file come last."""
    modules = (import_module(f"{__name__}.{module.name}") for module in iter_modules(__path__))
    return tuple(sorted((m.READER for m in modules if hasattr(m, "READER")), key=lambda reader: reader.rank))


def reader_of(path: Path) -> Reader | None:
    """The format of a source, or None if no format recognises it.

    **Raises:** `InputError` for a source that does not exist, cannot be read or is empty.
    """
    head = _head(path)
    return next((reader for reader in readers() if reader.recognises(path, head)), None)


def tables_of(path: Path, options: RecordingOptions, damage: Damage) -> tuple[Reader, list[Table]]:
    """The format of a source and its tables; damage is added to `damage`.

    **Raises:** `InputError` for a source that no format recognises or that is damaged, and for a library that is not
    installed.
    """
    if reader := reader_of(path):
        return reader, [table.plain() for table in reader.read(Source(path, options, damage))]
    head = _head(path)
    if words := no_text_words(head):
        raise InputError(f"{path}: this is {words}")
    if (path / "journal.log").is_file():
        raise InputError(
            f"{path}: this is the folder of a capture. For its samples, give {path / 'raw.log'}. For its position "
            f"means, run: {suggested('reduce', path, less=EVERY)}"
        )
    check_zero_bytes(path, head, "text")
    words = f": {unknown_words(head)}" if head else ""
    known = "; ".join(reader.title for reader in readers())
    raise InputError(f"{path}: no format recognises it{words}. Supported formats: {known}")


def _head(path: Path) -> bytes:
    """The first bytes of a file; none of a folder."""
    if path.is_dir():
        return b""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file or folder") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    if not head:
        raise InputError(f"{path}: the file is empty")
    return head
