"""The terminal of a command: its width, warnings, and progress."""

import logging
import os
import shutil
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from tumblecal.ground.errors import one_line


def warn(source: object, lines: Iterable[str]) -> None:
    """Print warnings on stderr, one line each."""
    for line in lines:
        print(f"WARNING: {source}: {one_line(line)}", file=sys.stderr)


def terminal_width() -> int | None:
    """The width of the terminal to which is printed; None for a pipe or a file, whose lines are not folded."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() or "COLUMNS" in os.environ else None


def columns() -> int:
    """Width of a formatted text: 100 columns, or that of a narrower terminal."""
    from tumblecal.show.verdict import WIDTH

    return min(WIDTH, terminal_width() or WIDTH)


def print_folded(text: str) -> None:
    """Print paragraphs, folded between words on a terminal, otherwise one line each."""
    if width := terminal_width():
        from tumblecal.show.narrow import folded

        text = folded(text, width)
    print(text, flush=True)


def print_progress_messages() -> None:
    """From now on the messages of the program about its progress are printed on stderr, with the time."""
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(relativeCreated)6.0f ms %(name)s: %(message)s"))
    logging.getLogger("tumblecal").addHandler(handler)
    logging.getLogger("tumblecal").setLevel(logging.DEBUG)


@contextmanager
def progress(words: str) -> Iterator[None]:
    """Show progress and elapsed time on stderr, if it is a terminal."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        shown.add_task(words, total=None)
        yield
