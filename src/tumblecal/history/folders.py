"""Entries of output folders of calibrate, diagnose and check, and the stored files that a user names."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from tumblecal.data.budget_result import NAME, with_budget_in_folder
from tumblecal.data.not_applied import losses_words
from tumblecal.data.position_comments import measured_at
from tumblecal.data.result_records import (
    CHECK,
    DIAGNOSIS,
    REMEDY,
    RESULT,
    CheckFile,
    DiagnosisFile,
    ResultFile,
    read_checked,
)
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import shortened
from tumblecal.ground.strict_json import read_record
from tumblecal.ground.text_file import read_text
from tumblecal.history.database import documents
from tumblecal.history.entry import USE, WHEN, Entry


# The document of each kind of result, and what it states; calibration.json may be in the same folder.
_KINDS = {"calibration": (RESULT, ResultFile), "diagnosis": (DIAGNOSIS, DiagnosisFile), "check": (CHECK, CheckFile)}
_SHOWN = 10


def entries_of(folder: Path) -> list[Entry]:
    """The entries of all results in an output folder.

    **Raises:** `InputError` for a folder without results.
    """
    kinds = [kind for kind, (name, _) in _KINDS.items() if (folder / name).is_file()]
    if not kinds:
        raise InputError(
            f"{folder}: no {' or '.join([name for name, _ in _KINDS.values()])}; give an output folder of calibrate, diagnose "
            "or check"
        )
    return [of_folder(folder, kind) for kind in kinds]


def of_folder(folder: Path, kind: str, serial: str | None = None) -> Entry:
    """The entry of an output folder of calibrate, diagnose or check; that of a check has no parameters, so it is on no chart.

    **Arguments:**

    - `kind`: calibration, diagnosis or check. `serial`: of the unit, if the caller has it.

    **Raises:** `InputError` if the folder has no such result.
    """
    name, record = _KINDS[kind]
    stored = {name: read_text(folder / name, "JSON")}
    parameters, combined, provenance, path = None, False, {}, folder / "calibration.json"
    corrected = None
    if kind != "check" and path.exists():
        stored[path.name] = read_text(path, "JSON")
        corrected = read_checked(path)
    result = read_record(folder / name, record, REMEDY)
    outcome = result.outcome
    if isinstance(result, CheckFile):
        serial, outcome = serial or result.serial_number, f"{outcome}{USE}{result.answer}"
        provenance = {"measured_utc": result.measured_utc}
    elif corrected is not None and ("verdict" in corrected.provenance) == (kind == "diagnosis"):
        degc = corrected.temperature.usual_degc if corrected.temperature else None
        parameters = with_budget_in_folder(path, corrected, degc)
        if combined := parameters is not None:
            stored[NAME] = read_text(folder / NAME, "JSON")
        parameters = parameters or (corrected if degc is None else corrected.at(degc)).sensor
        outcome += "" if degc is None else f"; values at {degc:.4g} degC"
        outcome += "".join([f"; {words}" for words in losses_words(corrected.not_applied, reasons=False)])
        outcome += f"{USE}{corrected.use.answer or 'not stated'}"
        serial, provenance = serial or corrected.serial_number, corrected.provenance
    elif corrected is None and isinstance(result, DiagnosisFile) and result.answer != "no":
        raise InputError(f"{folder / name}: calibration.json of this diagnosis is missing; {REMEDY}")
    return Entry(
        kind=kind,
        serial=serial or "",
        date_utc=_date(folder / name, provenance.get("measured_utc") or provenance.get("date_utc")),
        sha256=str(provenance.get("sha256") or result.sha256 or ""),
        parameters=parameters,
        combined=combined,
        documents=stored,
        source=result.source,
        outcome=outcome,
        rms_g=result.rms_g,
        p_value=result.p_value,
    )


def _date(path: Path, stated: object) -> str:
    """A stated date in UTC, or the modification time of the file.

    **Raises:** `InputError` for a text that is not a date.
    """
    if stated is None:
        return datetime.fromtimestamp(path.stat().st_mtime, UTC).strftime(WHEN)
    read = measured_at(str(stated), str(path))
    return (read.astimezone(UTC) if read.tzinfo else read).strftime(WHEN)


def require_named(database: Path, entries: Sequence[Entry], serial: str | None, number: int | None) -> None:
    """Check that a unit has results, and that a result is one of them.

    **Raises:** `InputError` with those that exist.
    """
    units = sorted({entry.serial for entry in entries if not entry.damaged} - {""})
    if serial is not None and serial not in units:
        raise InputError(
            f"{database}: no unit {serial}; units: {shortened(units, _SHOWN) or 'none with a serial number'}"
        )
    numbers = [entry.number for entry in entries if serial in (None, entry.serial)]
    if serial is not None and number is not None and number not in numbers:
        shown = shortened([*map(str, numbers)], _SHOWN)
        raise InputError(f"--files {number}: not a result of unit {serial}; its results are {shown}")


def stored_files(database: Path, number: int, out: Path | None) -> tuple[dict[str, str], str]:
    """The stored files of a result, and the names of damaged ones, which are not among them; `out`: their new folder.

    **Raises:** `InputError` for an unknown number, no folder, or a folder that has such files.
    """
    stored, damaged = documents(database, number)
    words = ", ".join(damaged)
    if not stored:
        reason = (
            f"damaged in {database}: {words}; restore it from a copy" if damaged else f"{database} has no such files"
        )
        raise InputError(f"--files {number}: {reason}")
    if out is None:
        raise InputError(f"--files {number}: give a folder with --out")
    if existing := sorted(name for name in stored if (out / name).exists()):
        raise InputError(f"{out}: has {', '.join(existing)} already; give a different folder with --out")
    return stored, words
