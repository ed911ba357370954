"""The terminal of a command: its width, warnings, and progress."""

import logging
import math
import os
import shutil
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from tumblecal.ground.errors import one_line
from tumblecal.ground.plain_text import plain


if TYPE_CHECKING:
    from tumblecal.show.tables import Table


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


def print_folded(*paragraphs: "str | Table") -> None:
    """Print paragraphs and tables: on a terminal folded between words, and in parts below one another; otherwise one line for
    each paragraph and row."""
    width = terminal_width()
    text = plain("\n".join(one if isinstance(one, str) else one.fitted(width or math.inf) for one in paragraphs))
    if width:
        from tumblecal.show.narrow import folded

        text = folded(text, width)
    if text:
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
