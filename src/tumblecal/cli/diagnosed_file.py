"""One position file of `tumblecal diagnose`: its diagnosis, and its results."""

from dataclasses import replace
from functools import partial
from pathlib import Path

from numpy.linalg import LinAlgError

from tumblecal.chain.head_file import MeasuredHead
from tumblecal.cli.diagnosis_batch import DIAGNOSIS_SET, Batch
from tumblecal.cli.outcomes import Outcome
from tumblecal.cli.positions_read import Read
from tumblecal.cli.result_files import add_to_history
from tumblecal.data.repeats import unfinished
from tumblecal.diagnosis import Diagnosis
from tumblecal.estimation.methods import require_measured, require_noise
from tumblecal.ground.errors import InputError
from tumblecal.ground.result_set import result_set
from tumblecal.lab.summary import diagnosis_row
from tumblecal.lab.terms import lacking_words
from tumblecal.planning import NextPlan, next_plan
from tumblecal.show.diagnosis import words_of_diagnosis, write_diagnosis


# Printed for joined files without a column mount, if something was found.
ONE_MOUNTING = (
    "Assumed: one mounting for all files. If the triad was removed from its fixture between them, add a column mount "
    "(such as A and B)."
)


def diagnosed_file(batch: Batch, file: Path, folder: Path, read: Read, head: MeasuredHead | None) -> Outcome:
    """Diagnose one file, with the measured errors of its head, and write its results."""
    try:
        diagnosis = _diagnosed(batch, read, head)
    except InputError as fault:
        return Outcome(diagnosis_row(file, fault), fault.faults, f"{file}: rejected")
    plan = next_plan(diagnosis, batch.allowed) if batch.single else NextPlan()
    words, figures = words_of_diagnosis(diagnosis, plan, folder), batch.more.figures
    of_head = replace(batch.model, head=head).of_head(diagnosis.problem)
    with result_set(folder, DIAGNOSIS_SET) as aside:
        drawn = batch.single if figures is None else figures
        write_diagnosis(aside, diagnosis, plan, figures=drawn, said=of_head, verdict=words.verdict)
    add_to_history(batch.more.history, folder, "diagnosis", diagnosis.data.serial_number)
    batch.command.warn(diagnosis.data.source, words.lines("warnings"))
    row, found = diagnosis_row(file, diagnosis), ", ".join(diagnosis.labels) or "nothing found"
    short = [f"{file}: {diagnosis.verdict}", found, *lacking_words(diagnosis.calibration, of_sensor=True)]
    one_mounting = len(diagnosis.data.files) > 1 and diagnosis.data.mount is None and diagnosis.verdict != "adequate"
    return Outcome(
        row, (), "; ".join(short), partial(batch.command.print_verdict, words.verdict, *[ONE_MOUNTING] * one_mounting)
    )


def _diagnosed(batch: Batch, read: Read, head: MeasuredHead | None) -> Diagnosis:
    """The diagnosis of one file.

    **Raises:** `InputError` for positions that cannot be diagnosed.
    """
    model = replace(batch.model, head=head)
    stated = batch.stated(read, model)
    require_measured(stated["data"])
    try:
        diagnosis = batch.diagnoser(from_rig=model.rig is not None, holdout=batch.holdout, **stated)
    except (MemoryError, LinAlgError) as error:
        raise unfinished(stated["data"], error) from error
    require_noise(diagnosis.extended)
    return replace(diagnosis, implausible=model.with_sources(diagnosis.implausible, diagnosis.extended.problem))
