"""What every command does once: start, printed output, files of a result, JSON, warnings and exit code."""

import json
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tumblecal.cli.options import Quiet, options
from tumblecal.cli.result_files import names_written
from tumblecal.cli.terminal import columns, print_folded, print_progress_messages, progress, warn
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.data.calibration_use import Use
    from tumblecal.show.tables import Table
    from tumblecal.show.verdict import Verdict


# Exit code for a result that must not be used; its files are written.
NOT_USABLE = 3


@options
class Command:
    """One call of a command, with its printed output."""

    quiet: Quiet = False
    verbose: Annotated[bool, Parameter(name=("--verbose", "-v"), help="Progress messages on stderr.")] = False
    json: Annotated[
        bool, Parameter(help="Result as JSON instead of words: one document for each file, one on each line.")
    ] = False

    def begin(self, *, computing: bool = True, one_thread: bool = False) -> None:
        """Apply the options; prepare the process for a command that computes.

        **Raises:** `InputError` for options that contradict each other.
        """
        other = "json" if self.json else "verbose"
        if self.quiet and (self.verbose or self.json):
            raise InputError(f"--quiet and --{other} contradict each other; give one of them")
        if self.verbose:
            print_progress_messages()
        if computing:
            from tumblecal.cli.start import start

            start(one_thread=one_thread)

    @property
    def words(self) -> bool:
        """Whether words are printed."""
        return not (self.quiet or self.json)

    def say(self, *paragraphs: "str | Table") -> None:
        """Print words and tables, unless JSON or silence is asked for; on a terminal paragraphs are folded, and tables are in
        parts below one another."""
        if self.words:
            print_folded(*paragraphs)

    def warn(self, source: object, lines: Iterable[str]) -> None:
        """Print warnings on stderr, one line each, if no words are printed that include them."""
        if not self.words:
            warn(source, lines)

    def print_verdict(self, verdict: "Verdict", *more: str) -> None:
        """Print a verdict, and lines after it."""
        from tumblecal.show.verdict import verdict_lines

        self.say(*verdict_lines(verdict, columns()), *more)

    def record(self, document: Path) -> None:
        """Print a written document on one line, if JSON is asked for."""
        if self.json:
            print(json.dumps(json.loads(document.read_text(encoding="utf-8"))), flush=True)

    def end(
        self, out: Path, names: Sequence[str], document: str, use: "Use | None" = None, source: str = "", more: str = ""
    ) -> int:
        """Print the names of the written files, or the document as JSON.

        **Arguments:**

        - `out`, `names`: as of `results`. `use`: of the result, made of `source`. `more`: words after the names.

        **Returns:** the exit code.
        """
        self.say(names_written(out, names) + more)
        self.record(out / document)
        if use is None or not use.refused:
            return 0
        self.warn(source, [f"use: {use.words}"])
        return NOT_USABLE

    def working(self, words: str) -> AbstractContextManager[None]:
        """Show progress and elapsed time on stderr, if it is a terminal and words are printed."""
        return progress(words) if self.words else nullcontext()
