"""Files that are whole or absent: written aside, brought to disk, then renamed."""

import errno
import os
import re
import tempfile
from collections.abc import Iterator, Sequence
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
    try:
        descriptor, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise _unwritable(path, error) from error
    os.close(descriptor)
    aside = Path(name)
    try:
        yield aside
        umask = os.umask(0)
        os.umask(umask)
        aside.chmod(0o666 & ~umask)
        # In this order the name never stands for less than the whole file, not even after a power cut.
        _to_disk(aside)
        os.replace(aside, path)
        _to_disk(path.parent)
    except Exception as error:
        refused = _refused_by_system(error)
        if refused is None:
            raise
        raise _unwritable(path, refused) from error
    finally:
        aside.unlink(missing_ok=True)


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


def write_text(path: Path, text: str) -> None:
    """Write `text` to `path` in UTF-8 (bytes of a file's name that are not text as ?), whole or not at all."""
    with written_aside(path) as aside:
        aside.write_text(text, encoding="utf-8", errors="replace")
