"""The outcomes of position files, one after another: printed when they are ready, with a summary of several files."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from tumblecal.cli.command import NOT_USABLE
from tumblecal.cli.position_files import SUMMARY, PositionFiles
from tumblecal.cli.result_files import names_written
from tumblecal.ground.errors import InputError


class Outcome(NamedTuple):
    """The outcome for one file: its row of the summary, faults, and words; `show` prints the result of a single file."""

    row: dict[str, Any]
    faults: Sequence[str] = ()
    words: str = ""
    show: Callable[[], object] | None = None
    refused: bool = False


def conclude(
    files: PositionFiles,
    outcomes: Iterator[Outcome],
    columns: Sequence[str],
    names: Sequence[str],
    document: str,
    doing: str,
    last: Callable[[Sequence[dict[str, Any]]], None] = lambda rows: None,
) -> int:
    """Print each outcome when it is ready, and write the summary of several files.

    **Arguments:**

    - `columns`: of the summary. `names`, `document`: files of a result, and the one that is printed as JSON.
    - `last`: called with the rows of the summary, when all files are done.

    **Returns:** the exit code.

    **Raises:** `InputError` with the faults of all files.
    """
    from tumblecal.ground.result_set import remove_results
    from tumblecal.lab.summary import write_summary

    rows, faults, refused, count = list[dict[str, Any]](), list[str](), False, len(files.files)
    if not files.single:
        remove_results(files.out, (SUMMARY,))  # it describes the results before the first one is replaced
    try:
        for number, (file, folder) in enumerate(zip(files.files, files.folders, strict=True), start=1):
            place = "" if files.single else f"{number} of {count}"
            with files.command.working(f"{doing} {file} {place}"):
                outcome = next(outcomes)
            rows.append(outcome.row)
            faults += outcome.faults
            refused |= outcome.refused
            if not files.single:
                files.command.say(f"{place}  {outcome.words}")
            elif outcome.show is not None:
                outcome.show()
                files.command.say(names_written(folder, names))
            if document and not outcome.faults:
                files.command.record(folder / document)
    finally:
        # The summary of an interrupted command has the rows of the finished files.
        if not files.single:
            write_summary(files.out / SUMMARY, rows, columns)
    if not files.single:
        files.command.say(f"written: {files.out}/: {SUMMARY}, a folder for each file")
    last(rows)
    if faults:
        raise InputError(faults)
    return NOT_USABLE if refused else 0
