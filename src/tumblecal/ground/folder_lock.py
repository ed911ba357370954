"""Locks of the system, which die with their process: a folder of results, or a file in writing, belongs to one at a time."""

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tumblecal.ground.errors import InputError


# A process that was just killed holds its locks for a moment still.
_PATIENCE_S, _STEP_S = 0.3, 0.05
# Folders that this process holds, by device and number of their entry.
_HELD: set[tuple[int, int]] = set()
# Files that it is writing, with their descriptors.
_FILES: dict[Path, int] = {}


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Keep other processes from writing results into `folder`; within one process it may be held several times.

    On a file system without locks nobody is kept out.

    **Raises:** `InputError` at once where another process holds it.
    """
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        status = os.fstat(descriptor)
        own = (status.st_dev, status.st_ino)
        if own in _HELD:
            yield
            return
        deadline = time.monotonic() + _PATIENCE_S
        while not _locked(descriptor):
            if time.monotonic() > deadline:
                raise InputError(
                    f"{folder}: another process{_holder(status.st_ino)} is writing its results here; wait for it, or give "
                    "another folder with --out"
                )
            time.sleep(_STEP_S)
        _HELD.add(own)
        try:
            yield
        finally:
            _HELD.discard(own)
    finally:
        os.close(descriptor)


def is_held(folder: Path) -> bool:
    """Whether any process holds `folder`."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            return not _locked(descriptor)
        finally:
            os.close(descriptor)
    return False


def locked(path: Path) -> None:
    """Lock a file that is being written, until `unlocked` or the end of the process, so that `remove_unlocked` lets it be."""
    with suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY)
        _FILES[path] = descriptor
        _locked(descriptor)


def unlocked(path: Path) -> None:
    """Let a file go that this process had locked; nothing where it had not."""
    descriptor = _FILES.pop(path, None)
    if descriptor is not None:
        os.close(descriptor)


def remove_unlocked(path: Path) -> None:
    """Remove a file that no process has locked any more."""
    with suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            path.unlink()
        finally:
            os.close(descriptor)


def _locked(descriptor: int) -> bool:
    """Lock an open folder or file, where nobody else has; what cannot be locked counts as locked."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


def _holder(inode: int) -> str:
    """The number of the process that holds a folder, in words, where the system lists it (Linux)."""
    with suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/locks").read_text("ascii").splitlines():
            words = line.split()
            if "FLOCK" in words and words[5].rpartition(":")[2] == str(inode) and int(words[4]) > 0:
                return f" ({words[4]})"
    return ""
