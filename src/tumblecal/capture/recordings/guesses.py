"""What was guessed of a recording goes with a fault that may follow from it: the command line prints it before."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from tumblecal.ground.errors import InputError


@contextmanager
def guessed(lines: Sequence[str]) -> Iterator[None]:
    """Add lines, as they are when it happens, to an `InputError` as its notes; each once."""
    try:
        yield
    except InputError as error:
        for line in lines:
            if line not in getattr(error, "__notes__", ()):
                error.add_note(line)
        raise
