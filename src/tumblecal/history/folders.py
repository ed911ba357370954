"""Entries of output folders of calibrate, diagnose and check."""

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
from tumblecal.ground.strict_json import read_record
from tumblecal.ground.text_file import read_text
from tumblecal.history.entry import USE, WHEN, Entry


# The document of each kind of result; calibration.json may be in the same folder.
DOCUMENTS = {"calibration": RESULT, "diagnosis": DIAGNOSIS, "check": CHECK}


def entries_of(folder: Path) -> list[Entry]:
    """The entries of all results in an output folder.

    **Raises:** `InputError` for a folder without results.
    """
    kinds = [kind for kind, name in DOCUMENTS.items() if (folder / name).is_file()]
    if not kinds:
        raise InputError(
            f"{folder}: no {' or '.join(DOCUMENTS.values())}; give an output folder of calibrate, diagnose or check"
        )
    return [of_folder(folder, kind) for kind in kinds]


def of_folder(folder: Path, kind: str, serial: str | None = None) -> Entry:
    """The entry of an output folder of calibrate or diagnose.

    **Arguments:**

    - `kind`: calibration, diagnosis or check. `serial`: of the unit, if the caller has it.

    **Raises:** `InputError` if the folder has no such result.
    """
    name = DOCUMENTS[kind]
    if name == CHECK:
        return _of_check(folder / name, serial)
    documents = {name: read_text(folder / name, "JSON")}
    corrected, path = None, folder / "calibration.json"
    if path.exists():
        documents[path.name] = read_text(path, "JSON")
        corrected = read_checked(path)
    result = read_record(folder / name, ResultFile if name == RESULT else DiagnosisFile, REMEDY)
    outcome = result.outcome
    if corrected is not None and ("verdict" in corrected.provenance) != (name == DIAGNOSIS):
        corrected = None  # of the other command, in the same folder
    elif corrected is None and isinstance(result, DiagnosisFile) and result.answer != "no":
        raise InputError(f"{folder / name}: calibration.json of this diagnosis is missing; {REMEDY}")
    curves = corrected.temperature if corrected else None
    degc = curves.usual_degc if curves else None
    budgeted = with_budget_in_folder(path, corrected, degc) if corrected else None
    if budgeted is not None:
        documents[NAME] = read_text(folder / NAME, "JSON")
    if corrected is not None:
        outcome += "" if degc is None else f"; values at {degc:.4g} degC"
        outcome += "".join([f"; {words}" for words in losses_words(corrected.not_applied, reasons=False)])
        outcome += f"{USE}{corrected.use.answer or 'not stated'}"
    at_degc = corrected if corrected is None or degc is None else corrected.at(degc)
    provenance = corrected.provenance if corrected else {}
    calibrated = corrected.serial_number if corrected else None
    return Entry(
        kind=kind,
        serial=serial or calibrated or "",
        date_utc=_date(folder / name, provenance.get("measured_utc") or provenance.get("date_utc")),
        sha256=str(provenance.get("sha256") or result.sha256 or ""),
        parameters=budgeted or (at_degc and at_degc.sensor),
        combined=budgeted is not None,
        documents=documents,
        source=result.source,
        outcome=outcome,
        rms_g=result.rms_g,
        p_value=result.p_value,
    )


def _of_check(path: Path, serial: str | None) -> Entry:
    """The entry of a check: it has no parameters, so it is on no chart."""
    result = read_record(path, CheckFile, REMEDY)
    return Entry(
        kind="check",
        serial=serial or result.serial_number or "",
        date_utc=_date(path, result.measured_utc),
        source=result.source,
        sha256=result.sha256 or "",
        outcome=f"{result.outcome}{USE}{result.answer}",
        p_value=result.p_value,
        documents={CHECK: read_text(path, "JSON")},
    )


def _date(path: Path, stated: object) -> str:
    """A stated date in UTC, or the modification time of the file.

    **Raises:** `InputError` for a text that is not a date.
    """
    if stated is None:
        return datetime.fromtimestamp(path.stat().st_mtime, UTC).strftime(WHEN)
    read = measured_at(str(stated), str(path))
    return (read.astimezone(UTC) if read.tzinfo else read).strftime(WHEN)
