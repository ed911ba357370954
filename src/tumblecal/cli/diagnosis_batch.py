"""The files of one call of `tumblecal diagnose`, in this process or in worker processes."""

import os
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tumblecal.cli.command import Command, add_to_history
from tumblecal.cli.options import ModelOptions, ResultOptions
from tumblecal.cli.position_files import Outcome
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.chain.head_file import MeasuredHead
    from tumblecal.cli.model_options import StatedModel
    from tumblecal.cli.position_files import Read
    from tumblecal.diagnosis import Diagnoser
    from tumblecal.diagnosis.screening.screened import Screened
    from tumblecal.planning import Allowed
    from tumblecal.recordings.dwells.dwell_samples import DwellSamples


# Starting a worker process takes as long as the diagnosis of so many files.
_FILES_A_PROCESS = 40
# The files of one diagnosis.
DIAGNOSIS_SET = (
    "diagnosis.json", "verdict.txt", "calibration.json", "extended_rig.toml", "suggested_effect.py",
    "next_positions.toml", "next_positions_*.toml", "diagnosis.html", "finding_*.svg",
    "residuals_by_angle.svg", "residuals_by_column.svg", "residual_harmonics.svg",
    "explanations.svg", "predictive.svg", "limits.svg", "unexplained.svg",
)  # fmt: skip


@dataclass
class Batch:
    """Options common to all files of one call; sent to the worker processes. `note`: printed if something is found."""

    options: ModelOptions
    holdout: tuple[str, str] | None
    samples: "DwellSamples | None"
    allowed: "Allowed"
    single: bool
    more: ResultOptions
    max_rows: int | None
    command: Command
    note: str = ""

    @cached_property
    def model(self) -> "StatedModel":
        """The model of the options."""
        from tumblecal.cli.model_options import StatedModel

        return StatedModel.of(self.options)

    @cached_property
    def diagnoser(self) -> "Diagnoser":
        """The diagnoser of all files."""
        from tumblecal.diagnosis import Diagnoser

        return Diagnoser(self.model.entries, self.single, self.model.usual)

    def run(
        self,
        files: Sequence[Path],
        folders: Sequence[Path],
        read: "Sequence[Read]",
        workers: int | None,
        heads: "Sequence[MeasuredHead | None] | None" = None,
    ) -> Iterator[Outcome]:
        """The outcome of each file, in order, when it is ready; `heads`: measured errors of the head for each file, if they
        differ."""
        heads = [self.model.head] * len(read) if heads is None else heads
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        workers = max(1, min(cores, len(read) // _FILES_A_PROCESS)) if workers is None else workers
        if workers == 1 or len(read) == 1:
            yield from map(self.diagnosed, files, folders, read, heads)
            return
        # Without the model and the diagnoser, which each process prepares.
        pool = ProcessPoolExecutor(workers, get_context("spawn"), initializer=_work, initargs=(replace(self),))
        try:
            yield from pool.map(_diagnosed, files, folders, read, heads)
        finally:
            pool.shutdown(cancel_futures=True)

    def screened(self, read: "Read") -> "Screened":
        """The screen of one file; nothing is written.

        **Raises:** `InputError` for positions that cannot be diagnosed.
        """
        from tumblecal.estimation.methods import require_noise

        begun = self.diagnoser.begun(**self._options(read, self.model), samples=self.samples)
        require_noise(begun.extended)
        return begun.screened

    def _options(self, read: "Read", model: "StatedModel") -> dict[str, Any]:
        """Averaged positions and their stated model, as keyword arguments of a diagnosis.

        **Raises:** `InputError` for a file that could not be read, and for more positions than allowed.
        """
        from tumblecal.data.repeats import in_bounds

        if isinstance(read, InputError):
            raise read
        sampled = self.samples is not None
        bounded = in_bounds(read, model.noise_sd, self.max_rows, sampled=sampled)
        if self.single:
            self.command.say(bounded.words)
        known = bounded.noise_sd is not None or model.known(bounded.data) or sampled
        chain = model.chain(bounded.data, known=known) if model.described else None
        return {
            "data": bounded.data,
            "chain": chain,
            "noise_sd": bounded.noise_sd,
            "priors": model.priors if chain is None else model.stated(chain, bounded.data, known=known),
            "ability": model.slow_noise(bounded.data, sampled=sampled),
        }

    def diagnosed(self, file: Path, folder: Path, read: "Read", head: "MeasuredHead | None") -> Outcome:
        """Diagnose one file, with the measured errors of its head, and write its results."""
        from numpy.linalg import LinAlgError

        from tumblecal.estimation.methods import require_measured, require_noise
        from tumblecal.ground.result_set import result_set
        from tumblecal.lab.diagnosed_use import lacking_of_diagnosis
        from tumblecal.lab.summary import diagnosis_row
        from tumblecal.planning import NextPlan, next_plan
        from tumblecal.show.diagnosis import verdict_of_diagnosis, words_of_diagnosis, write_diagnosis
        from tumblecal.show.verdict import verdict_lines

        model = replace(self.model, head=head)
        try:
            stated = self._options(read, model) | {"holdout": self.holdout, "samples": self.samples}
            require_measured(stated["data"])
            diagnosis = self.diagnoser(from_rig=model.rig is not None, **stated)
            require_noise(diagnosis.extended)
            unusual = model.with_sources(diagnosis.implausible, diagnosis.extended.problem)
            diagnosis = replace(diagnosis, implausible=unusual)
        except (InputError, MemoryError, LinAlgError) as error:
            fault = error if isinstance(error, InputError) else _unfinished(read, error)
            return Outcome(diagnosis_row(file, fault), fault.faults, f"{file}: rejected")
        plan = next_plan(diagnosis, self.allowed) if self.single else NextPlan()
        words = words_of_diagnosis(diagnosis, plan, folder)
        verdict = verdict_of_diagnosis(diagnosis, words=words)
        figures, head_record = self.more.figures, model.of_head(diagnosis.problem)
        with result_set(folder, DIAGNOSIS_SET) as aside:
            drawn = self.single if figures is None else figures
            write_diagnosis(aside, diagnosis, plan, figures=drawn, said=head_record, verdict=verdict)
        add_to_history(self.more.history, folder, "diagnosis", diagnosis.data.serial_number)
        self.command.warn(diagnosis.data.source, words.lines("warnings"))
        row, found = diagnosis_row(file, diagnosis), ", ".join(diagnosis.labels) or "nothing found"
        short = [f"{file}: {diagnosis.verdict}", found, *lacking_of_diagnosis(diagnosis, of_sensor=True)]
        if not self.single:
            return Outcome(row, words="; ".join(short))
        note = [self.note] if self.note and diagnosis.verdict != "adequate" else []
        lines = [*verdict_lines(verdict, self.command.columns), *note]
        return Outcome(row, show=partial(self.command.say, *lines))


def _unfinished(read: "Read", error: Exception) -> InputError:
    """The fault of a file whose diagnosis ended with an error of the computation."""
    from tumblecal.data.repeats import cost

    assert not isinstance(read, InputError)
    if isinstance(error, MemoryError):
        return InputError(
            f"{read.source}: not enough memory for {len(read)} positions ({cost(len(read))}); average repeats, or diagnose "
            "parts of the file separately"
        )
    return InputError(
        f"{read.source}: the model cannot be fitted to these readings (singular equations); check angles, axes and units "
        "against the measurement log"
    )


_batch: Batch | None = None


def _work(batch: Batch) -> None:
    """Prepare a worker process; interrupts are handled by the parent process."""
    global _batch
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from tumblecal.cli.commands import warn_in_one_line
    from tumblecal.cli.start import start

    warn_in_one_line()
    start(one_thread=True)
    _batch = batch


def _diagnosed(file: Path, folder: Path, positions: "Read", head: "MeasuredHead | None") -> Outcome:
    assert _batch is not None
    return _batch.diagnosed(file, folder, positions, head)
