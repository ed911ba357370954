"""Locks of the operating system, which end with their process: one process at a time writes a folder or a file."""

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tumblecal.ground.errors import InputError


# The locks of a killed process remain for a short time.
_PATIENCE_S, _STEP_S = 0.3, 0.05
# Folders that this process has locked, by device and inode.
_LOCKED: set[tuple[int, int]] = set()
# Files that it is writing, with their descriptors.
_FILES: dict[Path, int] = {}


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Lock `folder` against other processes that write results; one process can lock it several times.

    Without effect on a file system without locks.

    **Raises:** `InputError` at once if another process has locked it.
    """
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        status = os.fstat(descriptor)
        inode = (status.st_dev, status.st_ino)
        if inode in _LOCKED:
            yield
            return
        deadline = time.monotonic() + _PATIENCE_S
        while not _locked(descriptor):
            if time.monotonic() > deadline:
                raise InputError(
                    f"{folder}: another process{_holder(status.st_ino)} is writing its results here; wait for it, or give "
                    "a different folder with --out"
                )
            time.sleep(_STEP_S)
        _LOCKED.add(inode)
        try:
            yield
        finally:
            _LOCKED.discard(inode)
    finally:
        os.close(descriptor)


def is_held(folder: Path) -> bool:
    """Whether any process has locked `folder`."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            return not _locked(descriptor)
        finally:
            os.close(descriptor)
    return False


def locked(path: Path) -> None:
    """Lock a file during writing, until `unlocked` or the end of the process, so that `remove_unlocked` keeps it."""
    with suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY)
        _FILES[path] = descriptor
        _locked(descriptor)


def unlocked(path: Path) -> None:
    """Unlock a file that this process has locked; otherwise without effect."""
    descriptor = _FILES.pop(path, None)
    if descriptor is not None:
        os.close(descriptor)


def remove_unlocked(path: Path) -> None:
    """Remove a file that no process has locked."""
    with suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            path.unlink()
        finally:
            os.close(descriptor)


def _locked(descriptor: int) -> bool:
    """Lock an open folder or file, unless another process has; true also if it cannot be locked."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


def _holder(inode: int) -> str:
    """The number of the process that has locked a folder, in words, if the system lists it (Linux)."""
    with suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/locks").read_text("ascii").splitlines():
            words = line.split()
            if "FLOCK" in words and words[5].rpartition(":")[2] == str(inode) and int(words[4]) > 0:
                return f" ({words[4]})"
    return ""
