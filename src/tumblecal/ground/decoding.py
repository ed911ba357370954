"""Errors of libraries that decode files, converted to one line with the fault of the file."""

import contextlib
import errno
import io
import os
import re
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tumblecal.ground.errors import InputError


ADVICE = "copy or export it again"
# Errors of the operating system, which are no damage of the file.
_REFUSED = (errno.EACCES, errno.EPERM, errno.ENOENT, errno.EISDIR, errno.EIO, errno.EMFILE, errno.ENOSPC)

# Text of native libraries for an error of the operating system.
_OF_SYSTEM = re.compile(r"\(os error (\d+)\)")


def damaged(path: Path, kind: str, error: BaseException | str, advice: str = ADVICE) -> InputError:
    """The line for a file that its decoder cannot read, or with a wrong checksum."""
    worded = _OF_SYSTEM.search(str(error))
    number = int(worded[1]) if worded else getattr(error, "errno", None)
    if number in _REFUSED:
        return InputError(f"{path}: cannot be read ({os.strerror(number)})")
    if isinstance(error, MemoryError):
        return InputError(f"{path}: not enough memory to read it; split the file, or close other programs")
    words = (str(error).splitlines() or [""])[0].strip() or type(error).__name__
    return InputError(f"{path}: not a complete {kind} ({words[:200]}); {advice}")


@contextmanager
def decoding(path: Path, kind: str, advice: str = ADVICE) -> Iterator[None]:
    """Decode a file with a library within the block.

    Libraries raise any exception for damaged bytes, including `SystemError` and panics of native code, which are not an
    `Exception`. All are caught, except those that end the program or a generator.

    **Raises:** `InputError` naming the file, its kind and the remedy.
    """
    try:
        yield
    except (InputError, KeyboardInterrupt, SystemExit, GeneratorExit):
        raise
    except BaseException as error:
        raise damaged(path, kind, error, advice) from error


@contextmanager
def silenced() -> Iterator[None]:
    """Suppress output of libraries on a damaged file (in Python, as warnings, or in native threads)."""
    sys.stderr.flush()
    stderr, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(null)
