"""A command of tumblecal in this process, with all that it and the libraries below it print."""

import os
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from tumblecal.cli.run import run


@dataclass(frozen=True)
class Outcome:
    """The exit code, what was printed, and the traceback of an exception that came through."""

    code: int
    printed: str
    told: str
    traceback: str = ""


def ran(words: Sequence[object]) -> Outcome:
    """Run a command; native code prints to the descriptors, so that these are read."""
    code, fault, arguments = 0, "", sys.argv
    sys.argv = ["tumblecal", *map(str, words)]
    with _held(1) as printed, _held(2) as told, warnings.catch_warnings():
        warnings.simplefilter("default")
        try:
            code = run()
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            fault = traceback.format_exc()
        finally:
            sys.argv = arguments
            sys.stdout.flush()
            sys.stderr.flush()
    return Outcome(code, "".join(printed), "".join(told), fault)


@contextmanager
def _held(descriptor: int) -> Iterator[list[str]]:
    """What a descriptor gets, put into the list at the end."""
    texts = list[str]()
    kept = os.dup(descriptor)
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), descriptor)
        try:
            yield texts
        finally:
            (sys.stdout if descriptor == 1 else sys.stderr).flush()
            os.dup2(kept, descriptor)
            os.close(kept)
            file.seek(0)
            texts.append(file.read().decode("utf-8", "replace"))
