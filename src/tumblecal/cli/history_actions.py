"""What `tumblecal history` does with results: it adds, restores and evaluates them."""

from collections.abc import Sequence
from pathlib import Path

from tumblecal.cli.result_files import names_written, results
from tumblecal.cli.terminal import print_folded, warn
from tumblecal.ground.atomic import write_text
from tumblecal.ground.errors import InputError
from tumblecal.ground.suggested_command import suggested
from tumblecal.history.database import add
from tumblecal.history.folders import entries_of, stored_files
from tumblecal.show.history_list import damage_lines


_SET = ("history.html", "history_*.svg")
UNUSED = " is not used, because it is damaged"


def add_results(database: Path, folders: Sequence[Path], *, example: bool) -> None:
    """Add the results of folders, and the runs of the paper.

    **Raises:** `InputError` for a folder without results; then nothing is added.
    """
    entries = [entry for folder in folders for entry in entries_of(folder)]
    if example:
        from tumblecal.cli.start import start

        start()
        from tumblecal.lab.paper_runs import paper_runs

        entries += paper_runs()
    if entries:
        new = sum(add(database, entry) for entry in entries)
        print(f"{database}: {new} of {len(entries)} added{' (the others were in it)' if new < len(entries) else ''}")


def restore(database: Path, number: int, out: Path | None) -> int:
    """Write the stored files of a result, except damaged ones, which are named; returns 1 if there are any.

    **Raises:** `InputError` as `stored_files`.
    """
    stored, damaged = stored_files(database, number, out)
    assert out is not None
    with results(out, ()) as aside:
        for name, text in stored.items():
            write_text(aside / name, text)
    print(names_written(out, sorted(stored)))
    if damaged:
        warn(database, [f"result {number}: not written, damaged: {damaged}; restore the history from a copy"])
    return 1 if damaged else 0


def evaluate(database: Path, serial: str, limits: dict[str, float], risk: float, out: Path | None) -> None:
    """Print the history of a unit, and write its page.

    **Raises:** `InputError` for a unit without a calibration.
    """
    from tumblecal.history.database import of_unit
    from tumblecal.history.repeatability import unit_history
    from tumblecal.show.history import history_text, words_of_history, write_history

    entries = of_unit(database, serial)
    warn(database, damage_lines(entries, UNUSED))
    judged = unit_history(entries, limits)
    if not judged.entries:
        raise InputError(
            f"{database}: no result of {serial} has a calibration; list all results without the serial number"
        )
    words = words_of_history(serial, judged, risk)
    pages = f"tables and control charts: {suggested('history', database, serial, '--out', 'page')}"
    if out is not None:
        with results(out, _SET) as aside:
            write_history(aside, words, judged)
        pages = names_written(out, _SET)
    print_folded(f"{history_text(words)}\n{pages}")
