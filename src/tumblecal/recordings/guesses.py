"""Guesses about a recording are attached to a fault that may follow from them; the command line prints them first."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from tumblecal.ground.errors import InputError


@contextmanager
def guessed(lines: Sequence[str]) -> Iterator[None]:
    """Add the lines to an `InputError` as its notes, each once."""
    try:
        yield
    except InputError as error:
        for line in lines:
            if line not in getattr(error, "__notes__", ()):
                error.add_note(line)
        raise
