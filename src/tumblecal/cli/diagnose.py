"""`tumblecal diagnose`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import Parameter

from tumblecal.cli.diagnosis_batch import DIAGNOSIS_SET, Batch, processes_for
from tumblecal.cli.join_options import ONE_MOUNTING, JoinOptions
from tumblecal.cli.options import ModelOptions, NextPositions, ResultOptions
from tumblecal.cli.output import Output
from tumblecal.cli.subfolders import subfolders
from tumblecal.cli.units_together import SUMMARY, UNITS_SET
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.data import PositionSet
    from tumblecal.recordings.dwells.dwell_samples import DwellSamples


# Files in the output folders of one file or a batch.
_WRITTEN = (*DIAGNOSIS_SET, *UNITS_SET, SUMMARY)


@Parameter(name="*")
@dataclass(frozen=True)
class InputOptions:
    """Relation of the files to each other, and to raw samples.

    Parameters
    ----------
    samples
        Raw samples of the position means: folder of tumblecal capture, or table (.csv, .parquet) with columns position,
        ax_g, ay_g, az_g, time_s. Their noise, including its slow part, weights the positions. With --join: one table for
        all files. Default: none. Example: --samples run1.
    units
        Files of different units (triads), measured on one dividing head: separates errors of the head from those of each
        sensor, and writes head.toml for --head. Example: diagnose A1.csv A2.csv --units.
    holdout
        Data held out of the fit to measure the improvement: a run, a mounting or positions. Default: each run, or
        each position, in turn. Example: --holdout run=3.
    workers
        Number of worker processes for a batch. Default: one for every 40 files, at most one for each core. Example:
        --workers 2.
    max_rows
        Largest number of positions used without averaging. If there are more, repeats are averaged; more than 1000 after
        averaging are rejected with an estimate of the cost, unless this option allows them. Default: 400. Example:
        --max-rows 2000.
    """

    samples: Path | None = None
    units: bool = False
    holdout: str | None = None
    workers: int | None = None
    max_rows: int | None = None

    def check(self, *, join: bool) -> None:
        """Check the numbers; `join`: whether the files are joined.

        **Raises:** `InputError` for one that is too small, and for options that contradict each other.
        """
        if self.workers is not None and self.workers < 1:
            raise InputError(f"--workers {self.workers}: at least 1")
        if self.units and join:
            raise InputError(
                "--units treats each file as a different triad, --join treats all as one; give only one of these options"
            )
        if self.max_rows is not None and self.max_rows < 3:
            raise InputError(f"--max-rows {self.max_rows}: at least 3")

    def held_out(self) -> tuple[str, str] | None:
        """Column and value of the held-out data; None if not given.

        **Raises:** `InputError` for a text that is not COLUMN=VALUE.
        """
        if self.holdout is None:
            return None
        column, equals, value = self.holdout.partition("=")
        if not equals or not value:
            raise InputError(f"--holdout {self.holdout}: write a column and a value, such as run=3")
        return column.strip(), value.strip()

    def raw(self, data: Sequence[Path], noise_sd: str | None, *, join: bool) -> "DwellSamples | None":
        """The raw samples; None if not given.

        **Raises:** `InputError` if they cannot be samples of the data, or if the noise is also stated.
        """
        if self.samples is None:
            return None
        if noise_sd is not None:
            raise InputError("--samples and --noise-sd both state the noise; give only one of these options")
        if len(data) > 1 and not join:
            raise InputError(
                f"--samples {self.samples}: samples of one position file, but {len(data)} files are given; diagnose each file "
                "separately"
            )
        from tumblecal.recordings.dwells.position_samples import read_position_samples

        return read_position_samples(self.samples)


def diagnose(
    data: list[Path],
    /,
    *,
    model: ModelOptions = ModelOptions(),
    out: Path = Path("diagnosis"),
    inputs: InputOptions = InputOptions(),
    joining: JoinOptions = JoinOptions(),
    following: NextPositions = NextPositions(),
    results: ResultOptions = ResultOptions(),
    output: Output = Output(),
) -> int:
    """Find the errors of the model in measured positions, and their causes.

    Parameters
    ----------
    data
        Position files (.csv or .parquet). Several files are a batch: each is diagnosed separately, in a subfolder.
    out
        Output folder: diagnosis.json, verdict.txt, calibration.json of the extended model, plans of the next positions,
        figures, diagnosis.html (all results) and, for a batch, summary.csv. A folder with results of calibrate is rejected.
        Example: --out unit17.
    """
    from tumblecal.cli.start import start
    from tumblecal.studies.threads import use_one_thread

    output.begin()
    use_one_thread()
    start()
    from tumblecal.data.overwriting import DIAGNOSIS, protect_inputs, protect_other_results
    from tumblecal.ground.atomic import output_folders

    joining.check()
    inputs.check(join=joining.join)
    if inputs.units and model.head is not None:
        raise InputError("--units measures the errors of the head, --head states them; give only one of these options")
    if inputs.units and len(data) < 2:
        raise InputError("--units: only one file; give the files of at least two units to find their common errors")
    held_out, allowed, raw = inputs.held_out(), following.allowed(), inputs.raw(data, model.noise_sd, join=joining.join)
    single = joining.join or len(data) == 1
    batch = Batch(model, held_out, raw, allowed, single, results, inputs.max_rows, output)
    batch.ready()
    folders = subfolders(data[:1] if joining.join else data, out)
    protected = [*data, model.rig, model.head, inputs.samples, *model.effects, results.history]
    protect_inputs(protected, folders=[*folders, out], names=_WRITTEN)
    protect_other_results(DIAGNOSIS, [*folders, out])
    read = batch.read(data, together=single or inputs.units)
    if joining.join:
        parts = [part for part in read if not isinstance(part, InputError)]
        whole, words = joining.joined(parts, batch.rig)
        output.say(words)
        batch.compare_with_plan([whole])
        batch.note = ONE_MOUNTING if len(parts) > 1 and whole.mount is None else ""
        read, data = [whole], data[:1]
    else:
        batch.compare_with_plan(read)
    results.ready()
    with output_folders(folders, out):
        if inputs.units:
            from tumblecal.cli.units_together import diagnose_units

            units = [part for part in read if not isinstance(part, InputError)]
            faults = diagnose_units(batch, data, folders, units, inputs.workers, out)
        else:
            faults = _diagnosed(batch, data, folders, read, inputs.workers, out / SUMMARY)
        if faults:
            raise InputError(faults)
    return 0


def _diagnosed(
    batch: Batch,
    files: Sequence[Path],
    folders: Sequence[Path],
    read: Sequence["PositionSet | InputError"],
    workers: int | None,
    summary: Path,
) -> list[str]:
    """Diagnose the files, print each result when it is ready, and write the summary of a batch; returns the faults."""
    from tumblecal.ground.result_set import remove_results
    from tumblecal.lab.summary import DIAGNOSED, write_summary

    faults: list[str] = []
    rows: list[dict] = []
    output = batch.output
    try:
        processes = processes_for(len(read)) if workers is None else workers
        if not batch.single:
            remove_results(summary.parent, (SUMMARY,))  # it describes the results before the first one is replaced
        outcomes = batch.run(files, folders, read, processes)
        for number, folder in enumerate(folders, start=1):
            with output.working(
                f"diagnosing {files[number - 1]}{f' ({number} of {len(files)})' if len(files) > 1 else ''}"
            ):
                row, refused, text = next(outcomes)
            rows.append(row)
            faults += refused
            if text:
                output.say(text if batch.single else f"{number} of {len(files)}  {text}")
            if not refused:
                output.record(folder / "diagnosis.json")
    finally:
        # The summary of an interrupted batch has the rows of the finished files.
        if not batch.single:
            write_summary(summary, rows, DIAGNOSED)
    if not batch.single:
        output.say(f"written: {summary.parent}/: {summary.name}, a folder for each file")
    return faults
