"""`tumblecal history`: the results of all units."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tumblecal.cli.output import Quiet


if TYPE_CHECKING:
    from tumblecal.history.entry import Entry


@Parameter(name="*")
@dataclass(frozen=True)
class Criteria:
    """Limits for the comparison of results.

    Parameters
    ----------
    limit
        Largest allowed difference between results, of dK, bias, gamma or dtheta. Repeatable. Default: the paper's limits
        5e-4, 1.5 mg, 2 mrad and 5 mrad. Example: --limit 'bias=1 mg'.
    risk
        Probability that a parameter exceeds its limit by the end of the recalibration interval. Example: --risk 0.01.
    """

    limit: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    risk: float = 0.05

    def limits(self) -> dict[str, float]:
        """The limits in base units.

        **Raises:** `InputError` for texts that are not limits.
        """
        from tumblecal.data.sensor_parameters import GROUPS
        from tumblecal.ground.errors import InputError
        from tumblecal.ground.units import quantity
        from tumblecal.history.repeatability import PAPER_LIMITS

        if not 0 < self.risk < 1:
            raise InputError(f"--risk {self.risk:g}: a probability between 0 and 1")
        limits = dict(PAPER_LIMITS)
        for text in self.limit:
            name, _, size = (part.strip() for part in text.partition("="))
            if not size or name not in GROUPS:
                raise InputError(f"--limit {text!r}: write NAME=SIZE with {', '.join(GROUPS)}, e.g. 'bias=1 mg'")
            try:
                limits[name] = quantity(size, GROUPS[name][1])
            except InputError as error:
                raise InputError(f"--limit {text!r}: {error}") from error
            if not limits[name] > 0:
                raise InputError(f"--limit {text!r}: must be above 0")
        return limits


@Parameter(name="*")
@dataclass(frozen=True)
class AddedResults:
    """Results to add first.

    Parameters
    ----------
    add
        Output folder of calibrate, diagnose or check to add. Repeatable. Example: --add calibration.
    example
        The three runs of Table 2 of the paper, added as unit "paper".
    """

    add: Annotated[tuple[Path, ...], Parameter(negative=(), show_default=False)] = ()
    example: Annotated[bool, Parameter(negative=())] = False


_SET = ("history.html", "history_*.svg")


def history(
    database: Path,
    serial: str | None = None,
    /,
    *,
    added: AddedResults = AddedResults(),
    criteria: Criteria = Criteria(),
    files: int | None = None,
    out: Path | None = None,
    check: Annotated[bool, Parameter(negative=())] = False,
    quiet: Quiet = False,
) -> int:
    """List the results of all units, or evaluate those of one: changes, repeatability, recalibration interval.

    Parameters
    ----------
    database
        History file; calibrate, diagnose and check write it with --history.
    serial
        Serial number of the unit. Default: a list of all units.
    files
        Number of a result whose files (result.json, calibration.json, ...) are restored to the folder of --out. Example:
        --files 3 --out restored.
    out
        Folder for the page of the unit with control charts, or for restored files. Example: --out charts.
    check
        Test of all results by their checksums, and of the file by SQLite. Exit code 1 if something is damaged.
    """
    from tumblecal.ground.errors import InputError
    from tumblecal.history.database import listed

    if out is not None and serial is None and files is None:
        raise InputError(f"--out {out}: a page is for one unit; give its serial number after {database}")
    limits = criteria.limits()
    if check:
        if serial is not None or files is not None or out is not None or added != AddedResults():
            raise InputError(f"--check tests the whole file; give only {database}")
        return _checked(database)
    if serial is None and criteria != Criteria():
        raise InputError(f"--limit and --risk apply to one unit; give its serial number after {database}")
    if added.add or added.example:
        _added(database, added.add, example=added.example)
    if files is not None and serial is None:
        return _restore_files(database, files, out)
    entries = listed(database)
    _warned(database, [entry for entry in entries if entry.damaged])
    if serial is None:
        _list(database, entries)
        return 0
    if not (results := [entry.number for entry in entries if entry.serial == serial and not entry.damaged]):
        units = sorted({entry.serial for entry in entries if not entry.damaged} - {""})
        raise InputError(f"{database}: no unit {serial}; units: {', '.join(units[:10]) or 'none with a serial number'}")
    if files is None:
        _judged(database, serial, limits, criteria.risk, out)
        return 0
    if files not in results:
        listed_results = f"{', '.join(map(str, results[:10]))}{', ...' * (len(results) > 10)}"
        raise InputError(f"--files {files}: not a result of unit {serial}; its results are {listed_results}")
    return _restore_files(database, files, out)


def _checked(database: Path) -> int:
    """Print the damaged results; returns 1 if there are any."""
    from tumblecal.ground.counted import counted
    from tumblecal.history.database import checked

    entries, faults = checked(database)
    damaged = [entry for entry in entries if entry.damaged]
    for entry in damaged:
        print(f"{_of(entry)}: damaged: {entry.damaged}")
    for words in faults:
        print(f"SQLite: {words}")
    if not damaged and not faults:
        print(f"{database}: {counted(len(entries), 'result')}, none damaged")
        return 0
    print(
        f"{database}: {len(damaged)} of {counted(len(entries), 'result')} damaged, {counted(len(faults), 'fault')} of the file "
        "itself; restore it from a copy"
    )
    return 1


def _of(entry: "Entry") -> str:
    """The number of a result and, if it is known, its date."""
    return f"result {entry.number}{f' of {entry.date_utc[:10]}' if entry.date_utc else ''}"


def _warned(database: Path, damaged: "Sequence[Entry]") -> None:
    for entry in damaged:
        print(f"WARNING: {database}: {_of(entry)} is not used, because it is damaged: {entry.damaged}", file=sys.stderr)


def _added(database: Path, folders: Sequence[Path], *, example: bool) -> None:
    """Add the results of folders, and the runs of the paper.

    **Raises:** `InputError` for a folder without results; then nothing is added.
    """
    from tumblecal.ground.errors import InputError
    from tumblecal.history.database import add
    from tumblecal.history.folders import KINDS, of_folder

    entries = []
    for folder in folders:
        kinds = [kind for name, kind in KINDS.items() if (folder / name).is_file()]
        if not kinds:
            raise InputError(
                f"{folder}: no {' or '.join(KINDS)}; give an output folder of calibrate, diagnose or check"
            )
        entries += [of_folder(folder, kind) for kind in kinds]
    if example:
        entries += _example()
    new = sum(add(database, entry) for entry in entries)
    print(f"{database}: {new} of {len(entries)} added{' (the others were in it)' if new < len(entries) else ''}")


def _example() -> list:
    """The three runs of the paper, with the uncertainty of the exact fit to Table 1, which is one of the runs."""
    from tumblecal.cli.start import start

    start()
    from tumblecal.data import paper
    from tumblecal.data.sensor_parameters import MOUNT, SENSOR
    from tumblecal.estimation import exact, problem_of
    from tumblecal.history.folders import paper_runs
    from tumblecal.report.result_file import calibration_of

    return paper_runs(calibration_of(exact.fit(problem_of(paper.table1()))).sensor.of((*SENSOR, *MOUNT)).covariance)


def _restore_files(database: Path, number: int, out: Path | None) -> int:
    """Write the stored files of a result, except damaged ones, which are named; returns 1 if there are any.

    **Raises:** `InputError` for an unknown number, no output folder, or a folder that has such files.
    """
    from tumblecal.ground.atomic import write_text
    from tumblecal.ground.errors import InputError
    from tumblecal.ground.result_set import result_set
    from tumblecal.history.database import damaged_documents, documents

    stored, damaged = documents(database, number), damaged_documents(database, number)
    if damaged and not stored:
        raise InputError(f"--files {number}: damaged in {database}: {', '.join(damaged)}; restore it from a copy")
    if out is None or not stored:
        raise InputError(
            f"--files {number}: {'give a folder with --out' if stored else f'{database} has no such files'}"
        )
    existing = sorted(name for name in stored if (out / name).exists())
    if existing:
        raise InputError(f"{out}: has {', '.join(existing)} already; give a different folder with --out")
    with result_set(out, ()) as aside:
        for name, text in stored.items():
            write_text(aside / name, text)
    print(f"written: {out}/: {', '.join(sorted(stored))}")
    if damaged:
        words = f"result {number}: not written, damaged: {', '.join(damaged)}"
        print(f"WARNING: {database}: {words}; restore the history from a copy", file=sys.stderr)
    return 1 if damaged else 0


def _list(database: Path, entries: "Sequence[Entry]") -> None:
    from tumblecal.ground.counted import counted
    from tumblecal.ground.suggested_command import suggested
    from tumblecal.report.history_list import listed

    print(listed(entries))
    entries = [entry for entry in entries if not entry.damaged]
    units = len({entry.serial for entry in entries} - {""})
    nameless = sum(not entry.serial for entry in entries)
    named = f"{counted(len(entries) - nameless, 'result')} of {counted(units, 'unit')}"
    unnamed = f"{counted(nameless, 'result')} without a serial number (no unit; state `# serial_number:` in the data)"
    count = "; ".join([named] * (units > 0 or not nameless) + [unnamed] * (nameless > 0))
    print(f"{count}; one unit: {suggested('history', database, 'SERIAL')}")


def _judged(database: Path, serial: str, limits: dict[str, float], risk: float, out: Path | None) -> None:
    from tumblecal.ground.errors import InputError
    from tumblecal.ground.suggested_command import suggested
    from tumblecal.history.database import of_unit
    from tumblecal.history.repeatability import unit_history
    from tumblecal.report.history_words import history_text

    entries = of_unit(database, serial)
    _warned(database, [entry for entry in entries if entry.damaged])
    judged = unit_history(entries, limits)
    if not judged.entries:
        raise InputError(
            f"{database}: no result of {serial} has a calibration; list all results without the serial number"
        )
    pages = f"tables and control charts: {suggested('history', database, serial, '--out', 'page')}"
    if out is not None:
        from tumblecal.ground.result_set import result_set
        from tumblecal.report.history_page import write_history_page
        from tumblecal.show.figures.drawing import write_each
        from tumblecal.show.figures.history import FIGURES

        with result_set(out, _SET) as aside:
            names = write_each(aside, FIGURES, judged)
            names += write_history_page(aside / "history.html", serial, judged, risk, names)
        pages = f"written: {out}/: {', '.join(names)}"
    print(f"{history_text(serial, judged, risk)}\n{pages}")
