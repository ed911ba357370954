"""Printed output of a command: words, nothing, or the JSON that it wrote."""

import os
import shutil
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from tumblecal.cli.interrupts import interrupted
from tumblecal.ground.errors import InputError, SupplementWarning, one_line
from tumblecal.ground.plain_text import plain


def warn(source: Path | str, warnings: Iterable[str]) -> None:
    """Print warnings on stderr, one line each."""
    for warning in warnings:
        print(f"WARNING: {source}: {one_line(warning)}", file=sys.stderr)


def warn_in_one_line() -> None:
    """From now on a missing figure or page is one line on stderr."""
    warnings.formatwarning = _words


_OTHERS = warnings.formatwarning


def _words(message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None) -> str:
    if not issubclass(category, SupplementWarning):
        return _OTHERS(message, category, filename, lineno, line)
    if interrupted():  # compiled modules convert the exception of a signal into other errors
        raise KeyboardInterrupt
    return f"WARNING: {message}\n"


# With this option `commands.run` discards what a command prints to stdout.
Quiet = Annotated[bool, Parameter(name=("--quiet", "-q"), negative=(), help="No output except warnings and errors.")]


@Parameter(name="*")
@dataclass(frozen=True)
class Output:
    """Printed output."""

    quiet: Quiet = False
    verbose: Annotated[bool, Parameter(name=("--verbose", "-v"), negative=(), help="Progress messages on stderr.")] = (
        False
    )
    json: Annotated[
        bool,
        Parameter(negative=(), help="Result as JSON instead of words: one document for each file, one on each line."),
    ] = False

    def begin(self) -> None:
        """Apply the options.

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
        """Width of a formatted text: 100 columns, or that of a narrower terminal."""
        from tumblecal.show.verdict import WIDTH

        return min(WIDTH, shutil.get_terminal_size().columns) if self._on_terminal else WIDTH

    def say(self, text: str) -> None:
        """Print words, unless JSON or silence is asked for; folded on a terminal, otherwise one line for each paragraph."""
        if self.words and text:
            text = plain(text)
            if self._on_terminal:
                from tumblecal.show.narrow import folded

                text = folded(text, shutil.get_terminal_size().columns)
            print(text, flush=True)

    def warn(self, source: str, warnings: Iterable[str]) -> None:
        """Print warnings on stderr, one line each, if no words are printed that contain them."""
        if not self.words:
            warn(source, warnings)

    def record(self, path: Path) -> None:
        """Print a written JSON file on one line, if JSON is asked for."""
        if self.json:
            import json

            print(json.dumps(json.loads(path.read_text(encoding="utf-8"))), flush=True)

    @contextmanager
    def working(self, words: str) -> Iterator[None]:
        """Show progress and elapsed time on stderr, if it is a terminal."""
        if not self.words or not sys.stderr.isatty():
            yield
            return
        from rich.console import Console
        from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
        with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
            progress.add_task(words, total=None)
            yield
