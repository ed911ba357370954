"""What every command does once: start, printed output, files of a result, JSON, warnings and exit code."""

import json
import os
import shutil
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tumblecal.cli.options import Quiet, options
from tumblecal.ground.errors import InputError, one_line
from tumblecal.ground.plain_text import plain
from tumblecal.ground.suggested_command import suggested


if TYPE_CHECKING:
    from tumblecal.data.calibration_use import Use
    from tumblecal.recordings.recording import Recording


# Exit code for a result that must not be used; its files are written.
NOT_USABLE = 3


def warn(source: object, lines: Iterable[str]) -> None:
    """Print warnings on stderr, one line each."""
    for line in lines:
        print(f"WARNING: {source}: {one_line(line)}", file=sys.stderr)


def table_file(path: Path, inputs: Iterable[Path | None]) -> Path:
    """A table to write, checked before the work begins.

    **Raises:** `InputError` for another kind of file, one of the inputs, or one that cannot be written.
    """
    from tumblecal.data.overwriting import protect_inputs
    from tumblecal.ground.atomic import writable_file

    protect_inputs(inputs, out=path)
    if path.suffix not in (".csv", ".parquet"):
        raise InputError(f"{path}: must end in .csv or .parquet")
    writable_file(path)
    return path


@contextmanager
def results(out: Path, names: Sequence[str], inputs: Iterable[Path | None] = ()) -> Iterator[Path]:
    """A temporary folder for the files of a result. When the block ends, they replace those of the earlier result in `out`.

    **Arguments:**

    - `names`: glob patterns of the files. `inputs`: of the command.

    **Raises:** `InputError`, before the work begins, if a file of the result is an input or cannot be written.
    """
    from tumblecal.data.overwriting import protect_inputs
    from tumblecal.ground.atomic import output_folders
    from tumblecal.ground.result_set import result_set

    protect_inputs(inputs, folders=[out], names=names)
    with output_folders([out]), result_set(out, names) as aside:
        yield aside


def names_written(out: Path, names: Sequence[str]) -> str:
    """The files of a result, for the last line of a command."""
    return f"written: {out}/: {', '.join(path.name for name in names for path in sorted(out.glob(name)))}"


def terminal_width() -> int | None:
    """The width of the terminal to which is printed; None for a pipe or a file, whose lines are not folded."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() or "COLUMNS" in os.environ else None


def add_to_history(history: Path | None, folder: Path, kind: str, serial: str | None) -> None:
    """Add the results of a folder to a history, if one is given.

    **Raises:** `InputError` if they cannot be added; the folder keeps them.
    """
    if history is None:
        return
    from tumblecal.history.database import add
    from tumblecal.history.folders import of_folder

    try:
        add(history, of_folder(folder, kind, serial))
    except InputError as error:
        later = f"the results are in {folder}/; add them later: {suggested('history', history, '--add', folder)}"
        raise InputError([f"{fault}; {later}" for fault in error.faults]) from error
    if serial is None:
        state = "so it belongs to no unit: state the number in the data (# serial_number: ...)"
        warn(history, [f"{folder} was added without a serial number, {state}"])


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
        if computing:
            from tumblecal.cli.start import start

            start(one_thread=one_thread)

    @property
    def words(self) -> bool:
        """Whether words are printed."""
        return not (self.quiet or self.json)

    @property
    def columns(self) -> int:
        """Width of a formatted text: 100 columns, or that of a narrower terminal."""
        from tumblecal.show.verdict import WIDTH

        return min(WIDTH, terminal_width() or WIDTH)

    def say(self, *paragraphs: str) -> None:
        """Print words, unless JSON or silence is asked for; folded on a terminal, otherwise one line for each paragraph."""
        text = plain("\n".join(paragraphs))
        if self.words and text:
            if width := terminal_width():
                from tumblecal.show.narrow import folded

                text = folded(text, width)
            print(text, flush=True)

    def warn(self, source: object, lines: Iterable[str]) -> None:
        """Print warnings on stderr, one line each, if no words are printed that include them."""
        if not self.words:
            warn(source, lines)

    def print_recordings(
        self, read: "Sequence[Recording]", warnings: Iterable[tuple[str, Iterable[str]]], lines: Iterable[str]
    ) -> None:
        """Print layout and guesses of recordings, warnings by file, and lines on their intervals at rest."""
        from tumblecal.show.recordings import layout_lines, left_out_lines

        self.say(*layout_lines(read), *lines)
        for recording in read:
            self.warn(recording.path, left_out_lines(recording))
        for source, of_source in warnings:
            warn(source, of_source)

    def record(self, document: Path) -> None:
        """Print a written document on one line, if JSON is asked for."""
        if self.json:
            print(json.dumps(json.loads(document.read_text(encoding="utf-8"))), flush=True)

    def end(
        self,
        out: Path,
        names: Sequence[str],
        document: str,
        use: "Use | None" = None,
        source: object = "",
        more: str = "",
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
