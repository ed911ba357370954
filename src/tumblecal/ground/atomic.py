"""Files that are whole or absent: written aside, brought to disk, then renamed."""

import errno
import os
import re
import secrets
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from tumblecal.ground.errors import InputError


def writable_folder(folder: Path) -> Path:
    """Make `folder` (and its parents) and check that files can be made in it.

    **Raises:** `InputError` when it cannot be made or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(
            f"{folder}: cannot write to this folder ({reason(error)}); give another one with --out"
        ) from error
    return folder


_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextmanager
def output_folders(folders: Sequence[Path]) -> Iterator[None]:
    """Make folders before a long computation; those left empty by a failure are removed again.

    **Raises:** `InputError` when one cannot be made or written.
    """
    new = [path for folder in folders for path in (folder, *folder.parents) if not path.exists()]
    try:
        for folder in folders:
            writable_folder(folder)
        yield
    except BaseException:
        for path in sorted(set(new), key=lambda path: -len(path.parts)):
            with suppress(OSError):
                path.rmdir()
        raise


@contextmanager
def written_aside(path: Path) -> Iterator[Path]:
    """A path beside `path` to write to; it takes the place of `path` when the block ends without an error.

    An interrupt or an error leaves an older `path` as it was, and no half-written file.

    **Raises:** `InputError` when `path` cannot be written, or is a folder.
    """
    aside = _aside(path)
    with _removed(aside), _refused(path):
        # Of its final rights from the start, whoever writes to it.
        aside.touch(exist_ok=False)
        yield aside
        # In this order the name never stands for less than the whole file, not even after a power cut.
        _to_disk(aside)
        os.replace(aside, path)
        _to_disk(path.parent)


def write_texts(folder: Path, texts: Mapping[str, str]) -> None:
    """Write files of one folder, by their names, as `write_text` writes one: all are on the disk before the first takes its
    name, and their names before the return.

    **Raises:** `InputError` as `written_aside`.
    """
    asides = {folder / name: _aside(folder / name) for name in texts}
    with _removed(*asides.values()):
        for (path, aside), text in zip(asides.items(), texts.values(), strict=True):
            with _refused(path), aside.open("xb") as file:
                file.write(text.encode("utf-8", "replace"))
                file.flush()
                os.fsync(file.fileno())
        for path, aside in asides.items():
            with _refused(path):
                os.replace(aside, path)
        with _refused(folder):
            _to_disk(folder)


def write_text(path: Path, text: str) -> None:
    """Write `text` to `path` in UTF-8 (bytes of a file's name that are not text as ?), whole or not at all.

    **Raises:** `InputError` as `written_aside`.
    """
    write_texts(path.parent, {path.name: text})


def _aside(path: Path) -> Path:
    """A name beside a path that nothing has."""
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}{path.suffix}")


@contextmanager
def _removed(*asides: Path) -> Iterator[None]:
    """What did not take its name is removed."""
    try:
        yield
    except BaseException:
        for aside in asides:
            with suppress(OSError):
                aside.unlink()
        raise


@contextmanager
def _refused(path: Path) -> Iterator[None]:
    """The system's refusal as an error of the user's input."""
    try:
        yield
    except Exception as error:
        refused = _refused_by_system(error)
        if refused is None:
            raise
        raise _unwritable(path, refused) from error


def _to_disk(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk."""
    if path.is_dir() and os.name != "posix":
        return
    descriptor = os.open(path, os.O_RDONLY if os.name == "posix" else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _unwritable(path: Path, error: OSError) -> InputError:
    if error.errno in _FULL:
        return InputError(f"{path}: not written, the disk is full (or has no room for so large a file); make room")
    return InputError(f"{path}: cannot be written ({reason(error)}); give another file")


def _refused_by_system(error: Exception) -> OSError | None:
    """The system's error, also out of an error of Polars, which only words it: `... (os error 28)`."""
    if isinstance(error, OSError) and error.errno is not None:
        return error
    number = re.search(r"\(os error (\d+)\)", str(error))
    if number:
        return OSError(int(number[1]), os.strerror(int(number[1])))
    return error if isinstance(error, OSError) else None


def reason(error: OSError) -> str:
    """Why the system refused; libraries leave `strerror` out."""
    return error.strerror or (str(error).splitlines() or ["unknown error"])[0]
