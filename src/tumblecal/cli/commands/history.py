"""`tumblecal history`: the results of all units."""

from pathlib import Path

from tumblecal.cli.options import Files, Probability, Quiet, Texts, options
from tumblecal.cli.terminal import warn
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted


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
    from tumblecal.cli.history_actions import UNUSED, add_results, evaluate, restore
    from tumblecal.history.database import checked, listed
    from tumblecal.history.folders import require_named
    from tumblecal.history.repeatability import limits_of
    from tumblecal.show.history_list import damage_lines, list_text

    if check:
        if serial is not None or files is not None or out is not None or added != AddedResults():
            raise InputError(f"--check tests the whole file; give only {database}")
        entries, faults = checked(database)
        found = [*damage_lines(entries, ": damaged"), *(f"SQLite: {fault}" for fault in faults)]
        outcome = f"{counted(len(found), 'fault')}; restore it from a copy" if found else "none damaged"
        print("\n".join([*found, f"{database}: {counted(len(entries), 'result')}, {outcome}"]))
        return 1 if found else 0
    if serial is None and (criteria != Criteria() or (out is not None and files is None)):
        raise InputError(f"--limit, --risk and --out are for one unit; give its serial number after {database}")
    limits = limits_of(criteria.limit)
    add_results(database, added.add, example=added.example)
    entries = listed(database)
    if files is None:
        warn(database, damage_lines(entries, UNUSED))
    require_named(database, entries, serial, files)
    if files is not None:
        return restore(database, files, out)
    if serial is None:
        print(list_text(database, entries))
    else:
        evaluate(database, serial, limits, criteria.risk, out)
    return 0
