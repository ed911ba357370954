"""`tumblecal history`: every result of every unit."""

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
    """What repeats may differ by.

    Parameters
    ----------
    limit
        Largest allowed difference between results, such as --limit 'bias=1 mg' (dK, bias, gamma, dtheta); the paper's
        where left out: 5e-4, 1.5 mg, 2 mrad, 5 mrad. May be given several times.
    risk
        Probability that a parameter has moved beyond its limit by the end of the recalibration interval.
    """

    limit: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    risk: float = 0.05

    def limits(self) -> dict[str, float]:
        """The limits in base units.

        **Raises:** `InputError` for texts that are none.
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
class Added:
    """What is added before.

    Parameters
    ----------
    add
        Folders of calibrate or diagnose to add; may be given several times.
    example
        Add the three runs of the paper's Table 2, as the unit "paper".
    """

    add: Annotated[tuple[Path, ...], Parameter(negative=(), show_default=False)] = ()
    example: Annotated[bool, Parameter(negative=())] = False


_SET = ("history.html", "history_*.svg")


def history(
    database: Path,
    serial: str | None = None,
    /,
    *,
    added: Added = Added(),
    criteria: Criteria = Criteria(),
    files: int | None = None,
    out: Path | None = None,
    check: Annotated[bool, Parameter(negative=())] = False,
    quiet: Quiet = False,
) -> int:
    """List the results of all units, or judge those of one: repeatability, drift, when to calibrate again.

    Parameters
    ----------
    database
        The history's file, which calibrate and diagnose write with --history.
    serial
        The unit's serial number; all units are listed where it is left out.
    files
        Number of a result whose files (result.json, calibration.json, ...) are written into --out, as they were.
    out
        Folder for the unit's page with control charts, or for those files.
    check
        Compare every part of every result with its checksum, and the file's structure with SQLite's rules. Ends with code 1
        where something is damaged.
    """
    from tumblecal.ground.errors import InputError
    from tumblecal.history.database import listed

    if out is not None and serial is None and files is None:
        raise InputError(f"--out {out}: the page is of one unit; give its serial number after {database}")
    limits = criteria.limits()
    if check:
        if serial is not None or files is not None or out is not None or added != Added():
            raise InputError(f"--check is of the whole file; give {database} and nothing more")
        return _checked(database)
    if serial is None and criteria != Criteria():
        raise InputError(f"--limit and --risk judge one unit; give its serial number after {database}")
    if added.add or added.example:
        _added(database, added.add, example=added.example)
    if files is not None and serial is None:
        return _written_again(database, files, out)
    entries = listed(database)
    _warned(database, [entry for entry in entries if entry.damaged])
    if serial is None:
        _list(database, entries)
        return 0
    if not (own := [entry.number for entry in entries if entry.serial == serial and not entry.damaged]):
        units = sorted({entry.serial for entry in entries if not entry.damaged} - {""})
        raise InputError(
            f"{database}: no unit {serial}; there are {', '.join(units[:10]) or 'none with a serial number'}"
        )
    if files is None:
        _judged(database, serial, limits, criteria.risk, out)
        return 0
    if files not in own:
        raise InputError(
            f"--files {files}: not of unit {serial}, which has {', '.join(map(str, own[:10]))}{', ...' * (len(own) > 10)}"
        )
    return _written_again(database, files, out)


def _checked(database: Path) -> int:
    """Say what is damaged; returns 1 where anything is."""
    from tumblecal.ground.counted import counted
    from tumblecal.history.database import checked

    entries, faults = checked(database)
    damaged = [entry for entry in entries if entry.damaged]
    for entry in damaged:
        print(f"{_of(entry)}: damaged: {entry.damaged}")
    for words in faults:
        print(f"SQLite: {words}")
    if not damaged and not faults:
        print(f"{database}: {counted(len(entries), 'result')}, all as they were written")
        return 0
    print(
        f"{database}: {len(damaged)} of {counted(len(entries), 'result')} damaged, {counted(len(faults), 'fault')} of the file "
        "itself; restore it from a copy"
    )
    return 1


def _of(entry: "Entry") -> str:
    """A result by its number and, where it is known, its date."""
    return f"result {entry.number}{f' of {entry.date_utc[:10]}' if entry.date_utc else ''}"


def _warned(database: Path, damaged: "Sequence[Entry]") -> None:
    for entry in damaged:
        print(f"WARNING: {database}: {_of(entry)} is not used, damaged: {entry.damaged}", file=sys.stderr)


def _added(database: Path, folders: Sequence[Path], *, example: bool) -> None:
    """Add what folders hold, and the paper's runs.

    **Raises:** `InputError` for a folder without results; then nothing is added.
    """
    from tumblecal.ground.errors import InputError
    from tumblecal.history.database import add
    from tumblecal.history.folders import KINDS, of_folder

    entries = []
    for folder in folders:
        kinds = [kind for name, kind in KINDS.items() if (folder / name).is_file()]
        if not kinds:
            raise InputError(f"{folder}: holds no {' or '.join(KINDS)}; give a folder that calibrate or diagnose wrote")
        entries += [of_folder(folder, kind) for kind in kinds]
    if example:
        entries += _example()
    new = sum(add(database, entry) for entry in entries)
    print(f"{database}: {new} of {len(entries)} added{' (the others were there)' if new < len(entries) else ''}")


def _example() -> list:
    """The paper's three runs; their uncertainty is that of the exact fit to Table 1, one of the runs."""
    from tumblecal.cli.start import start

    start()
    from tumblecal.data import paper
    from tumblecal.data.sensor_parameters import MOUNT, SENSOR
    from tumblecal.estimation import exact, problem_of
    from tumblecal.history.folders import paper_runs
    from tumblecal.report.result_file import calibration_of

    return paper_runs(calibration_of(exact.fit(problem_of(paper.table1()))).sensor.of((*SENSOR, *MOUNT)).covariance)


def _written_again(database: Path, number: int, out: Path | None) -> int:
    """Write a result's files as they were kept, but for damaged ones, which are named; returns 1 where there are any.

    **Raises:** `InputError` for a number that there is not, or without a folder that is free of them.
    """
    from tumblecal.ground.atomic import write_text
    from tumblecal.ground.errors import InputError
    from tumblecal.ground.result_set import result_set
    from tumblecal.history.database import damaged_documents, documents

    kept, damaged = documents(database, number), damaged_documents(database, number)
    if damaged and not kept:
        raise InputError(f"--files {number}: damaged in {database}: {', '.join(damaged)}; restore it from a copy")
    if out is None or not kept:
        raise InputError(f"--files {number}: {'give a folder with --out' if kept else f'{database} has no such files'}")
    there = sorted(name for name in kept if (out / name).exists())
    if there:
        raise InputError(f"{out}: has {', '.join(there)} already; give another folder with --out")
    with result_set(out, ()) as aside:
        for name, text in kept.items():
            write_text(aside / name, text)
    print(f"written: {out}/: {', '.join(sorted(kept))}")
    if damaged:
        words = f"result {number}: not written, damaged: {', '.join(damaged)}"
        print(f"WARNING: {database}: {words}; restore the history from a copy", file=sys.stderr)
    return 1 if damaged else 0


def _list(database: Path, entries: "Sequence[Entry]") -> None:
    from tumblecal.ground.counted import counted
    from tumblecal.ground.suggested_command import suggested
    from tumblecal.report.history_list import LISTED, listed_row, table_text

    print(table_text(LISTED, map(listed_row, entries), (1, 2, 3, 6)))
    entries = [entry for entry in entries if not entry.damaged]
    units = len({entry.serial for entry in entries} - {""})
    nameless = sum(not entry.serial for entry in entries)
    named = f"{counted(len(entries) - nameless, 'result')} of {counted(units, 'unit')}"
    unnamed = (
        f"{counted(nameless, 'result')} without a serial number (of no unit; state `# serial_number:` in the data)"
    )
    count = "; ".join([named] * (units > 0 or not nameless) + [unnamed] * (nameless > 0))
    print(f"{count}; one unit: {suggested('history', database, 'SERIAL')}")


def _judged(database: Path, serial: str, limits: dict[str, float], risk: float, out: Path | None) -> None:
    from tumblecal.ground.errors import InputError
    from tumblecal.history.database import of_unit
    from tumblecal.history.repeatability import unit_history
    from tumblecal.report.history_words import history_text

    entries = of_unit(database, serial)
    _warned(database, [entry for entry in entries if entry.damaged])
    judged = unit_history(entries, limits)
    if not judged.entries:
        raise InputError(f"{database}: no result of {serial} holds a calibration; list them without the serial number")
    written = ""
    if out is not None:
        from tumblecal.ground.result_set import result_set
        from tumblecal.report.history_page import write_history_page

        with result_set(out, _SET) as aside:
            names = write_history_page(aside, serial, judged, risk)
        written = f"\nwritten: {out}/: {', '.join(names)}"
    print(history_text(serial, judged, risk) + written)
