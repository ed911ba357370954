"""`tumblecal diagnose --units`: files of units measured on one dividing head."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.cli.diagnosis_batch import Batch, processes_for
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.data import PositionSet
    from tumblecal.diagnosis.screening.screened import Screened


# Files for all units together.
SUMMARY = "summary.csv"
UNITS_SET = ("diagnosis.json", "verdict.txt", "head.toml", "diagnosis.html", "shared_by_unit.svg")


def diagnose_units(
    batch: Batch,
    files: Sequence[Path],
    folders: Sequence[Path],
    read: Sequence["PositionSet"],
    workers: int | None,
    out: Path,
) -> list[str]:
    """Screen each unit, estimate common errors, diagnose each unit given these, and write all results; returns the faults."""
    from tumblecal.diagnosis.units import joint_diagnosis
    from tumblecal.ground.blas import single_blas_thread
    from tumblecal.ground.result_set import remove_results, result_set
    from tumblecal.lab.summary import DIAGNOSED, diagnosis_row, write_summary
    from tumblecal.report.head_files import write_units
    from tumblecal.report.head_words import units_text

    screened: list[Screened] = []
    usable, refused = [], {}
    with single_blas_thread(), batch.output.working(f"screening {len(read)} units"):
        for number, positions in enumerate(read):
            try:
                screened.append(batch.screened(positions))
                usable.append(number)
            except InputError as fault:
                refused[number] = fault
    if len(usable) < 2:
        faults = [text for fault in refused.values() for text in fault.faults]
        raise InputError([*faults, "--units: fewer than two units can be diagnosed; common errors need at least two"])
    with single_blas_thread(), batch.output.working("estimating errors common to the units"):
        measured = joint_diagnosis(screened, [str(files[k]) for k in usable], batch.usual)
    del screened
    heads = [measured.known_to(number) for number in range(len(usable))]
    chosen = [files[k] for k in usable]
    processes = processes_for(len(usable)) if workers is None else workers
    rows: dict[int, dict] = {number: diagnosis_row(files[number], fault) for number, fault in refused.items()}
    faults = [text for fault in refused.values() for text in fault.faults]
    # They describe the results of the units before the first one is replaced.
    remove_results(out, (*UNITS_SET, SUMMARY))
    outcomes = batch.run(chosen, [folders[k] for k in usable], [read[k] for k in usable], processes, heads)
    try:
        for number, (row, more, text) in zip(usable, outcomes, strict=True):
            rows[number] = row
            faults += more
            batch.output.say(f"{number + 1} of {len(files)}  {text}")
    finally:
        write_summary(out / SUMMARY, [rows[number] for number in sorted(rows)], DIAGNOSED)
    units = [(folders[k].name, rows[k]) for k in usable]
    with result_set(out, UNITS_SET) as aside:
        written = write_units(aside, measured, units, batch.entries, figures=batch.results.figures is not False)
    batch.output.say(f"{units_text(measured, units, batch.entries)}\nwritten: {out}/: {', '.join(written)}")
    batch.output.record(out / "diagnosis.json")
    return faults
