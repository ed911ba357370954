"""`tumblecal history`: the results of all units."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.cli.options import Files, Probability, Quiet, Texts, options
from tumblecal.cli.result_files import names_written, results
from tumblecal.cli.terminal import warn
from tumblecal.ground.counted import counted, shortened
from tumblecal.ground.errors import InputError
from tumblecal.ground.suggested_command import suggested


if TYPE_CHECKING:
    from tumblecal.history.entry import Entry

_SET = ("history.html", "history_*.svg")
_SHOWN = 10


@options
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

    limit: Texts = ()
    risk: Probability = 0.05


@options
class AddedResults:
    """Results to add first.

    Parameters
    ----------
    add
        Output folder of calibrate, diagnose or check to add. Repeatable. Example: --add calibration.
    example
        The three runs of Table 2 of the paper, added as unit "paper".
    """

    add: Files = ()
    example: bool = False


def history(
    database: Path,
    serial: str | None = None,
    /,
    *,
    added: AddedResults = AddedResults(),
    criteria: Criteria = Criteria(),
    files: int | None = None,
    out: Path | None = None,
    check: bool = False,
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
    from tumblecal.history.database import listed

    if check:
        if serial is not None or files is not None or out is not None or added != AddedResults():
            raise InputError(f"--check tests the whole file; give only {database}")
        return _check(database)
    if serial is None and (criteria != Criteria() or (out is not None and files is None)):
        raise InputError(f"--limit, --risk and --out are for one unit; give its serial number after {database}")
    limits = _limits(criteria)
    _add(database, added)
    entries = listed(database)
    if files is None:
        _warn(database, entries)
        if serial is None:
            _list(database, entries)
            return 0
    units = sorted({entry.serial for entry in entries if not entry.damaged} - {""})
    if serial is not None and serial not in units:
        raise InputError(
            f"{database}: no unit {serial}; units: {shortened(units, _SHOWN) or 'none with a serial number'}"
        )
    if files is not None:
        numbers = [entry.number for entry in entries if serial in (None, entry.serial)]
        if serial is not None and files not in numbers:
            shown = shortened([*map(str, numbers)], _SHOWN)
            raise InputError(f"--files {files}: not a result of unit {serial}; its results are {shown}")
        return _restore(database, files, out)
    _evaluate(database, str(serial), limits, criteria.risk, out)
    return 0


def _limits(criteria: Criteria) -> dict[str, float]:
    """The limits in base units.

    **Raises:** `InputError` for texts that are not limits.
    """
    from tumblecal.data.sensor_parameters import GROUPS
    from tumblecal.ground.option_texts import sizes
    from tumblecal.history.repeatability import PAPER_LIMITS

    units = {leaf: unit for leaf, (_, unit) in GROUPS.items()}
    return {**PAPER_LIMITS, **sizes("--limit ", criteria.limit, units, "'bias=1 mg'")}


def _check(database: Path) -> int:
    """Print the damaged results; returns 1 if there are any."""
    from tumblecal.history.database import checked

    entries, faults = checked(database)
    found = [f"{_of(entry)}: damaged: {entry.damaged}" for entry in entries if entry.damaged]
    found += [f"SQLite: {fault}" for fault in faults]
    outcome = f"{counted(len(found), 'fault')}; restore it from a copy" if found else "none damaged"
    print("\n".join([*found, f"{database}: {counted(len(entries), 'result')}, {outcome}"]))
    return 1 if found else 0


def _of(entry: "Entry") -> str:
    """The number of a result and, if it is known, its date."""
    return f"result {entry.number}{f' of {entry.date_utc[:10]}' if entry.date_utc else ''}"


def _warn(database: Path, entries: "Sequence[Entry]") -> None:
    damaged = (entry for entry in entries if entry.damaged)
    warn(database, (f"{_of(entry)} is not used, because it is damaged: {entry.damaged}" for entry in damaged))


def _add(database: Path, added: AddedResults) -> None:
    """Add the results of folders, and the runs of the paper.

    **Raises:** `InputError` for a folder without results; then nothing is added.
    """
    from tumblecal.history.database import add
    from tumblecal.history.folders import entries_of, paper_runs

    entries = [entry for folder in added.add for entry in entries_of(folder)]
    if added.example:
        from tumblecal.cli.start import start

        start()
        from tumblecal.data import paper
        from tumblecal.data.sensor_parameters import MOUNT, SENSOR
        from tumblecal.estimation import exact, problem_of
        from tumblecal.lab.record import calibration_of

        # The uncertainty of the exact fit to Table 1, which is one of the runs.
        fit = exact.fit(problem_of(paper.table1()))
        entries += paper_runs(calibration_of(fit).sensor.of((*SENSOR, *MOUNT)).covariance)
    if entries:
        new = sum(add(database, entry) for entry in entries)
        print(f"{database}: {new} of {len(entries)} added{' (the others were in it)' if new < len(entries) else ''}")


def _restore(database: Path, number: int, out: Path | None) -> int:
    """Write the stored files of a result, except damaged ones, which are named; returns 1 if there are any.

    **Raises:** `InputError` for an unknown number, no output folder, or a folder that has such files.
    """
    from tumblecal.ground.atomic import write_text
    from tumblecal.history.database import damaged_documents, documents

    stored, damaged = documents(database, number), ", ".join(damaged_documents(database, number))
    if not stored:
        reason = (
            f"damaged in {database}: {damaged}; restore it from a copy" if damaged else f"{database} has no such files"
        )
        raise InputError(f"--files {number}: {reason}")
    if out is None:
        raise InputError(f"--files {number}: give a folder with --out")
    if existing := sorted(name for name in stored if (out / name).exists()):
        raise InputError(f"{out}: has {', '.join(existing)} already; give a different folder with --out")
    with results(out, ()) as aside:
        for name, text in stored.items():
            write_text(aside / name, text)
    print(names_written(out, sorted(stored)))
    if damaged:
        warn(database, [f"result {number}: not written, damaged: {damaged}; restore the history from a copy"])
    return 1 if damaged else 0


def _list(database: Path, entries: "Sequence[Entry]") -> None:
    from tumblecal.show.history_list import listed

    print(listed(entries))
    serials = [entry.serial for entry in entries if not entry.damaged]
    named, nameless = [serial for serial in serials if serial], serials.count("")
    of_units = [f"{counted(len(named), 'result')} of {counted(len({*named}), 'unit')}"] if named else []
    if nameless:
        of_units.append(
            f"{counted(nameless, 'result')} without a serial number (no unit; state `# serial_number:` in the data)"
        )
    count = "; ".join(of_units) or "no results"
    print(f"{count}; one unit: {suggested('history', database, 'SERIAL')}")


def _evaluate(database: Path, serial: str, limits: dict[str, float], risk: float, out: Path | None) -> None:
    """Print the history of a unit, and write its page.

    **Raises:** `InputError` for a unit without a calibration.
    """
    from tumblecal.history.database import of_unit
    from tumblecal.history.repeatability import unit_history
    from tumblecal.show.history import history_text, verdict_of_history, words_of_history

    entries = of_unit(database, serial)
    _warn(database, entries)
    judged = unit_history(entries, limits)
    if not judged.entries:
        raise InputError(
            f"{database}: no result of {serial} has a calibration; list all results without the serial number"
        )
    words = words_of_history(serial, judged, risk)
    pages = f"tables and control charts: {suggested('history', database, serial, '--out', 'page')}"
    if out is not None:
        from tumblecal.show.figures.drawing import write_each
        from tumblecal.show.figures.history import FIGURES
        from tumblecal.show.history_list import listed
        from tumblecal.show.page import write_page

        with results(out, _SET) as aside:
            charts = write_each(aside, FIGURES, judged)
            write_page(
                *(aside / "history.html", words, charts),
                tables={"results": listed(judged.entries)},
                verdict=verdict_of_history(words),
            )
        pages = names_written(out, _SET)
    print(f"{history_text(words)}\n{pages}")
