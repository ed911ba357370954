"""One guard around the libraries that decode files: whatever they raise is a fault of the file, in one line."""

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
# What the system refuses is no damage.
_REFUSED = (errno.EACCES, errno.EPERM, errno.ENOENT, errno.EISDIR, errno.EIO, errno.EMFILE, errno.ENOSPC)

# Native libraries only word what the system said.
_OF_SYSTEM = re.compile(r"\(os error (\d+)\)")


def damaged(path: Path, kind: str, error: BaseException | str, advice: str = ADVICE) -> InputError:
    """The line for a file that its decoder cannot read, or whose checksum it does not have."""
    worded = _OF_SYSTEM.search(str(error))
    number = int(worded[1]) if worded else getattr(error, "errno", None)
    if number in _REFUSED:
        return InputError(f"{path}: cannot be read ({os.strerror(number)})")
    words = (str(error).splitlines() or [""])[0].strip() or type(error).__name__
    return InputError(f"{path}: not a whole {kind} ({words[:200]}); {advice}")


@contextmanager
def decoding(path: Path, kind: str, advice: str = ADVICE) -> Iterator[None]:
    """Decode a file with a library within the block.

    Libraries raise any exception on damaged bytes, `SystemError` and the panics of native code among them, which are no
    `Exception`; so all are caught but those that end the program or a generator.

    **Raises:** `InputError` naming the file, its kind and what to do.
    """
    try:
        yield
    except (InputError, KeyboardInterrupt, SystemExit, GeneratorExit):
        raise
    except BaseException as error:
        raise damaged(path, kind, error, advice) from error


@contextmanager
def silenced() -> Iterator[None]:
    """What libraries print about a damaged file (in Python, as warnings, or in native threads) is not for users."""
    sys.stderr.flush()
    kept, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 2)
    try:
        with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nothing)
