"""What a command says while and after it works: words, nothing, or the JSON that it wrote."""

import os
import shutil
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from tumblecal.ground.errors import InputError, one_line
from tumblecal.ground.plain_text import plain


def warn(source: Path | str, warnings: Iterable[str]) -> None:
    """Print what must not go unread, a line each on stderr."""
    for warning in warnings:
        print(f"WARNING: {source}: {one_line(warning)}", file=sys.stderr)


# What a command prints then, `commands.run` keeps from stdout.
Quiet = Annotated[bool, Parameter(name=("--quiet", "-q"), negative=(), help="Print nothing but warnings and errors.")]


@Parameter(name="*")
@dataclass(frozen=True)
class Output:
    """What is printed."""

    quiet: Quiet = False
    verbose: Annotated[
        bool, Parameter(name=("--verbose", "-v"), negative=(), help="Say as well what the program does, on stderr.")
    ] = False
    json: Annotated[
        bool,
        Parameter(
            negative=(), help="Print the result as JSON (of several files: one document a line) instead of words."
        ),
    ] = False

    def begin(self) -> None:
        """Take the options up.

        **Raises:** `InputError` for two that contradict each other.
        """
        if self.quiet and (self.verbose or self.json):
            raise InputError(
                f"--quiet and --{'json' if self.json else 'verbose'} contradict each other; give one of them"
            )
        if self.verbose:
            import logging

            handler = logging.StreamHandler()
            handler.setFormatter(logging.Formatter("%(relativeCreated)6.0f ms %(name)s: %(message)s"))
            logging.getLogger("tumblecal").addHandler(handler)
            logging.getLogger("tumblecal").setLevel(logging.DEBUG)

    @property
    def words(self) -> bool:
        """Whether words are printed."""
        return not (self.quiet or self.json)

    @property
    def _on_terminal(self) -> bool:
        return sys.stdout.isatty() or "COLUMNS" in os.environ

    @property
    def columns(self) -> int:
        """Columns of a text with a layout: at most its own 100, or the terminal's."""
        from tumblecal.report.verdict import WIDTH

        return min(WIDTH, shutil.get_terminal_size().columns) if self._on_terminal else WIDTH

    def say(self, text: str) -> None:
        """Print words, where these are asked for; on a terminal folded between words, elsewhere a paragraph a line."""
        if self.words and text:
            text = plain(text)
            if self._on_terminal:
                from tumblecal.report.narrow import folded

                text = folded(text, shutil.get_terminal_size().columns)
            print(text, flush=True)

    def warn(self, source: str, warnings: Iterable[str]) -> None:
        """Print what must not go unread, a line each on stderr, where no words are printed that would say it."""
        if not self.words:
            warn(source, warnings)

    def record(self, path: Path) -> None:
        """Print a written JSON file on one line, where JSON is asked for."""
        if self.json:
            import json

            print(json.dumps(json.loads(path.read_text(encoding="utf-8"))), flush=True)

    @contextmanager
    def working(self, words: str) -> Iterator[None]:
        """Show on a terminal (stderr) that work goes on, and for how long; nothing where stderr is none."""
        if not self.words or not sys.stderr.isatty():
            yield
            return
        from rich.console import Console
        from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
        with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
            progress.add_task(words, total=None)
            yield
