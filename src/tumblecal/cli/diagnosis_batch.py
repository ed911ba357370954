"""The files of one call of `tumblecal diagnose`, in this process or in worker processes."""

import os
import signal
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.chain.head_file import MeasuredHead
    from tumblecal.chain.rig import Rig
    from tumblecal.cli.options import ModelOptions, ResultOptions
    from tumblecal.cli.output import Output
    from tumblecal.data import PositionSet
    from tumblecal.diagnosis.screening.screened import Screened
    from tumblecal.effects import Catalogue
    from tumblecal.planning import Allowed
    from tumblecal.recordings.dwells.dwell_samples import DwellSamples


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

    options: "ModelOptions"
    holdout: tuple[str, str] | None
    samples: "DwellSamples | None"
    allowed: "Allowed"
    single: bool
    results: "ResultOptions"
    max_rows: int | None
    output: "Output"
    note: str = ""

    def ready(self) -> None:
        """Read the files of the options and prepare the diagnosis of all files.

        **Raises:** `InputError` for options that cannot be used.
        """
        from tumblecal.cli.model_options import StatedModel
        from tumblecal.diagnosis import Diagnoser

        self._model = StatedModel.of(self.options)
        self._diagnoser = Diagnoser(self._model.entries, self.single, self._model.usual)

    @property
    def entries(self) -> "Catalogue":
        """The catalogue, with the user's effects."""
        return self._model.entries

    @property
    def usual(self) -> "Mapping[str, float]":
        """The largest usual sizes of parameters that a rig states, base units."""
        return self._model.usual

    @property
    def rig(self) -> "Rig | None":
        """The rig of the options."""
        return self._model.rig

    def compare_with_plan(self, read: "Sequence[PositionSet | InputError]") -> None:
        """As `StatedModel.compare_with_plan`."""
        self._model.compare_with_plan(read)

    def read(self, files: Sequence[Path], *, together: bool) -> "list[PositionSet | InputError]":
        """As `StatedModel.read_each`, without a check of the size of the readings."""
        return self._model.read_each(files, together=together, check_size=False)

    def __getstate__(self) -> dict[str, Any]:
        """Without the attributes that each process prepares."""
        return {key: value for key, value in vars(self).items() if not key.startswith("_")}

    def run(
        self,
        files: Sequence[Path],
        folders: Sequence[Path],
        read: Sequence["PositionSet | InputError"],
        workers: int,
        heads: "Sequence[MeasuredHead | None] | None" = None,
    ) -> Iterator[tuple[dict[str, Any], list[str], str]]:
        """Summary row, faults and words of each file, in order, when each is ready; `heads`: measured errors of the head for
        each file, if they differ."""
        heads = [self._model.head] * len(read) if heads is None else heads
        if workers == 1 or len(read) == 1:
            yield from map(self.diagnosed, files, folders, read, heads)
            return
        pool = ProcessPoolExecutor(workers, get_context("spawn"), initializer=_work, initargs=(self,))
        try:
            yield from pool.map(_shared, files, folders, read, heads)
        finally:
            pool.shutdown(cancel_futures=True)

    def screened(self, positions: "PositionSet") -> "Screened":
        """The screen of one file; nothing is written.

        **Raises:** `InputError` for positions that cannot be diagnosed.
        """
        from tumblecal.estimation.methods import require_noise

        options = self._options(positions, self._model.head)
        begun = self._diagnoser.begun(**options, samples=self.samples)
        require_noise(begun.extended)
        return begun.screened

    def _options(self, positions: "PositionSet", head: "MeasuredHead | None") -> dict:
        """Averaged positions and their stated model, as keyword arguments of a diagnosis.

        **Raises:** `InputError` for more positions than allowed.
        """
        from tumblecal.data.repeats import in_bounds

        bounded = in_bounds(positions, self._model.noise_sd, self.max_rows, sampled=self.samples is not None)
        if self.single:
            self.output.say(bounded.words)
        model = replace(self._model, head=head)
        known = bounded.noise_sd is not None or model.known(bounded.data) or self.samples is not None
        chain = model.chain(bounded.data, known=known) if model.described else None
        priors = model.stated(chain, bounded.data, known=known) if chain is not None else model.priors
        ability = model.slow_noise(bounded.data, sampled=self.samples is not None)
        stated = {"noise_sd": bounded.noise_sd, "priors": priors, "ability": ability}
        return {"data": bounded.data, "chain": chain} | stated

    def diagnosed(
        self, file: Path, folder: Path, read: "PositionSet | InputError", head: "MeasuredHead | None"
    ) -> tuple[dict[str, Any], list[str], str]:
        """Diagnose one file, with the measured errors of its head, and write its results; a file that could not be read
        gives its fault."""
        from numpy.linalg import LinAlgError

        from tumblecal.estimation.methods import require_measured, require_noise
        from tumblecal.ground.result_set import result_set
        from tumblecal.lab.summary import diagnosis_row
        from tumblecal.planning import NextPlan, next_plan
        from tumblecal.report.diagnosis_calibration import lacking_of_diagnosis
        from tumblecal.report.diagnosis_details import warning_words
        from tumblecal.report.diagnosis_files import write_diagnosis
        from tumblecal.report.diagnosis_verdict import verdict_of_diagnosis
        from tumblecal.show.verdict import verdict_lines

        if isinstance(read, InputError):
            return self._refused(file, read)
        try:
            require_measured(read)
            diagnosis = self._diagnoser(
                holdout=self.holdout,
                samples=self.samples,
                from_rig=self._model.rig is not None,
                **self._options(read, head),
            )
            require_noise(diagnosis.extended)
        except InputError as fault:
            return self._refused(file, fault)
        except MemoryError:
            return self._refused(file, InputError(_too_large(read)))
        except LinAlgError:
            return self._refused(file, InputError(f"{read.source}: {_DIVERGED}"))
        model = replace(self._model, head=head)
        unusual = model.with_sources(diagnosis.implausible, diagnosis.extended.problem)
        diagnosis = replace(diagnosis, implausible=unusual)
        plan = next_plan(diagnosis, self.allowed) if self.single else NextPlan()
        figures = self.single if self.results.figures is None else self.results.figures
        head_record = model.of_head(diagnosis.problem)
        verdict = verdict_of_diagnosis(diagnosis, plan, folder)
        with result_set(folder, DIAGNOSIS_SET) as aside:
            written = write_diagnosis(aside, diagnosis, plan, figures=figures, said=head_record, verdict=verdict)
        self.results.in_history(folder, "diagnosis", diagnosis.data.serial_number)
        self.output.warn(diagnosis.data.source, warning_words(diagnosis))
        if self.single:
            note = f"\n{self.note}" if self.note and diagnosis.verdict != "adequate" else ""
            lines = verdict_lines(verdict, self.output.columns)
            text = "\n".join(lines) + f"{note}\nwritten: {folder}/: {', '.join(written)}"
        else:
            lacking = lacking_of_diagnosis(diagnosis, of_sensor=True)
            text = "; ".join([f"{file}: {diagnosis.verdict}", ", ".join(diagnosis.labels) or "nothing found", *lacking])
        return diagnosis_row(file, diagnosis), [], text

    def _refused(self, file: Path, fault: InputError) -> tuple[dict, list[str], str]:
        from tumblecal.lab.summary import diagnosis_row

        return diagnosis_row(file, fault), list(fault.faults), "" if self.single else f"{file}: rejected"


_DIVERGED = (
    "the model cannot be fitted to these readings (singular equations); check angles, axes and units against the "
    "measurement log"
)


def _too_large(positions: "PositionSet") -> str:
    from tumblecal.data.repeats import cost

    return (
        f"{positions.source}: not enough memory for {len(positions)} positions ({cost(len(positions))}); average repeats, "
        "or diagnose parts of the file separately"
    )


_batch: Batch | None = None


def _work(batch: Batch) -> None:
    """Prepare a worker process; interrupts are handled by the parent process."""
    global _batch
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from tumblecal.cli.output import warn_in_one_line
    from tumblecal.cli.start import start
    from tumblecal.studies.threads import use_one_thread

    warn_in_one_line()
    use_one_thread()
    start()
    batch.ready()
    _batch = batch


def _shared(
    file: Path, folder: Path, positions: "PositionSet | InputError", head: "MeasuredHead | None"
) -> tuple[dict, list[str], str]:
    assert _batch is not None
    return _batch.diagnosed(file, folder, positions, head)


def processes_for(files: int) -> int:
    """Number of processes that saves time: starting one takes as long as some 40 files."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(cores, files // _FILES_A_PROCESS))
