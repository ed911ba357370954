"""Faults of files that cannot be written, from the errors of the operating system."""

import errno
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tumblecal.ground.errors import InputError


FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextmanager
def unwritable_as_fault(path: Path) -> Iterator[None]:
    """Convert errors of the operating system to `InputError`."""
    try:
        yield
    except Exception as error:
        if _refused_by_system(error) is None:
            raise
        raise unwritable(path, error) from error


def unwritable(path: Path, error: Exception) -> InputError:
    """The fault of a file that cannot be written because of `error`, of the operating system or of polars."""
    refused = _refused_by_system(error) or OSError(str(error))
    if refused.errno in FULL:
        return InputError(
            f"{path}: not written, because the disk is full (or too small for this file); free some space"
        )
    return InputError(f"{path}: cannot be written ({reason(refused)}); give a different file")


def _refused_by_system(error: Exception) -> OSError | None:
    """The error of the operating system, also from the text of an error of polars: `... os error 28`."""
    if isinstance(error, OSError) and error.errno is not None:
        return error
    number = re.search(r"os error (\d+)", str(error))
    if number:
        return OSError(int(number[1]), os.strerror(int(number[1])))
    return error if isinstance(error, OSError) else None


def reason(error: OSError) -> str:
    """The reason in an error of the operating system; some libraries do not set `strerror`."""
    return error.strerror or (str(error).splitlines() or ["unknown error"])[0]
