"""Questions about a recording, and the guesses that are printed with them."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

from tumblecal.ground.errors import InputError


def question(path: object, words: str, options: Iterable[str]) -> InputError:
    """The fault of a recording that does not state an item, with the options that state it."""
    return InputError(": ".join(filter(None, [str(path), words, " or ".join(options)])))


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
