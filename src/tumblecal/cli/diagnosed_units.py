"""`tumblecal diagnose --units`: the units of one dividing head together, then each unit."""

from collections.abc import Sequence
from typing import Any

from tumblecal.cli.diagnosis_batch import DIAGNOSIS_SET, UNITS_SET, Batch
from tumblecal.cli.diagnosis_workers import diagnosed_files
from tumblecal.cli.outcomes import conclude
from tumblecal.cli.position_files import PositionFiles
from tumblecal.cli.positions_read import Read
from tumblecal.diagnosis.units import joint_diagnosis
from tumblecal.estimation.methods import require_noise
from tumblecal.ground.errors import InputError
from tumblecal.ground.result_set import remove_results, result_set
from tumblecal.lab.summary import DIAGNOSED
from tumblecal.show.units_together import words_of_units, write_units


def diagnosed_units(files: PositionFiles, batch: Batch, read: list[Read], workers: int | None) -> int:
    """Screen each unit, estimate common errors, diagnose each unit given these, and write all results.

    **Raises:** `InputError` with the faults of all files.
    """
    screened = {}
    with batch.command.working(f"screening {len(read)} units"):
        for number, positions in enumerate(read):
            try:
                begun = batch.diagnoser.begun(**batch.stated(positions, batch.model))
                require_noise(begun.extended)
                screened[number] = begun.screened
            except InputError as fault:
                read[number] = fault
    if len(screened) < 2:
        faults = [fault for part in read if isinstance(part, InputError) for fault in part.faults]
        raise InputError([*faults, "--units: fewer than two units can be diagnosed; common errors need at least two"])
    with batch.command.working("estimating errors common to the units"):
        measured = joint_diagnosis([*screened.values()], [str(files.files[k]) for k in screened], batch.model.usual)
    heads = {number: measured.known_to(place) for place, number in enumerate(screened)}
    del screened

    def write(rows: Sequence[dict[str, Any]]) -> None:
        units = [(files.folders[number].name, rows[number]) for number in heads]
        words, figures = words_of_units(measured, units, batch.model.entries), batch.more.figures is not False
        with result_set(files.out, UNITS_SET) as aside:
            write_units(aside, measured, units, batch.model.entries, words, figures=figures)
        batch.command.print_verdict(words.verdict)
        batch.command.end(files.out, UNITS_SET, "diagnosis.json")

    # They describe the results of the units before the first one is replaced.
    remove_results(files.out, UNITS_SET)
    outcomes = diagnosed_files(batch, files, read, workers, [heads.get(k) for k in range(len(read))])
    return conclude(files, outcomes, DIAGNOSED, DIAGNOSIS_SET, "", "diagnosing", write)
