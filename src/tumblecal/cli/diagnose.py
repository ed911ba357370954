"""`tumblecal diagnose`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tumblecal.cli.diagnosis_batch import DIAGNOSIS_SET, Batch, processes_for
from tumblecal.cli.options import ModelOptions, NextPositions, ResultOptions
from tumblecal.cli.output import Output
from tumblecal.cli.subfolders import subfolders
from tumblecal.cli.units_together import SUMMARY, UNITS_SET
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.capture.position_samples import PositionSamples
    from tumblecal.data import PositionSet


# Said of joined files without a column mount, where something was found.
_ONE_MOUNTING = (
    "The files count as one mounting: if the triad was taken out of its fixture between them, say so in a column mount "
    "(such as A and B)."
)

# What is in the folders of results, of one file or several.
_WRITTEN = (*DIAGNOSIS_SET, *UNITS_SET, SUMMARY)


@Parameter(name="*")
@dataclass(frozen=True)
class InputOptions:
    """How the files are taken.

    Parameters
    ----------
    samples
        The raw samples that the means were made of: the folder of tumblecal capture, or a table (.csv, .parquet) with
        columns position, ax_g, ay_g, az_g, time_s. Their noise, slow parts included, then weighs the positions. With
        --join the table holds the samples of all files.
    join
        Take the files as parts of one measurement. Each that has no column run is a run of its own, so pitch settings need
        not come back to within the noise from file to file.
    same_run
        With --join: files without a column run are one run, such as the first positions and those that were proposed next.
    pause
        With --join: the time from the last position of a file to the first of the next, such as '2 h', given once for all
        files or once for each later file; `unknown`, or `none` where the times of all files count by one clock. By default
        the files decide: by their comments time_zero, or where time_s goes on; otherwise the pause is unknown.
    units
        The files are of units (triads) measured on one head: tell errors of the head, which all of them share, from
        those of each sensor. Writes head.toml, the head's measured errors, for --head.
    holdout
        Data kept out of the fit when the gain is measured: run=3, mount=B or position=1-4.
    workers
        Processes that share several files; by default one for every 40 files, at most one a core.
    max_rows
        Positions that are taken one by one, by default 400. Of more, repeats are averaged; what cannot be averaged is
        refused above 1000 with what it would cost, and done where this allows it.
    """

    samples: Path | None = None
    join: bool = False
    same_run: Annotated[bool, Parameter(negative=())] = False
    pause: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    units: bool = False
    holdout: str | None = None
    workers: int | None = None
    max_rows: int | None = None

    def check(self) -> None:
        """Check the numbers.

        **Raises:** `InputError` for one that is too small.
        """
        if self.workers is not None and self.workers < 1:
            raise InputError(f"--workers {self.workers}: at least 1")
        if self.same_run and not self.join:
            raise InputError("--same-run says of joined files that they are one run; give --join as well")
        if self.pause and not self.join:
            raise InputError("--pause is the time between files that are joined; give --join as well")
        if self.units and self.join:
            raise InputError("--units takes every file as another triad, --join all of them as one; give one of them")
        if self.max_rows is not None and self.max_rows < 3:
            raise InputError(f"--max-rows {self.max_rows}: at least 3")

    def kept_out(self) -> tuple[str, str] | None:
        """Column and value of the data that are held out.

        **Raises:** `InputError` for a text that is not these two.
        """
        if self.holdout is None:
            return None
        column, equals, value = self.holdout.partition("=")
        if not equals or not value:
            raise InputError(f"--holdout {self.holdout}: write a column and a value, such as run=3")
        return column.strip(), value.strip()

    def raw(self, data: Sequence[Path], noise_sd: str | None) -> "PositionSamples | None":
        """The raw samples, where given.

        **Raises:** `InputError` when they cannot be those of the data, or the noise is stated a second time.
        """
        if self.samples is None:
            return None
        if noise_sd is not None:
            raise InputError("--samples and --noise-sd both say how large the noise is; give one of them")
        if len(data) > 1 and not self.join:
            raise InputError(
                f"--samples {self.samples}: belongs to one file of positions, but {len(data)} are given; run them apart"
            )
        from tumblecal.capture.position_samples import read_position_samples

        return read_position_samples(self.samples)


def diagnose(
    data: list[Path],
    /,
    *,
    model: ModelOptions = ModelOptions(),
    out: Path = Path("diagnosis"),
    inputs: InputOptions = InputOptions(),
    following: NextPositions = NextPositions(),
    results: ResultOptions = ResultOptions(),
    output: Output = Output(),
) -> int:
    """Find what the model gets wrong in measured positions, and why.

    Parameters
    ----------
    data
        Position files, .csv or .parquet. Several files are diagnosed one by one, each into its own subfolder.
    out
        Folder for diagnosis.json, verdict.txt, calibration.json of the extended model, plans of the next positions, the
        figures and diagnosis.html, which holds all of it; summary.csv where there are several files. One with results of
        calibrate is refused.
    """
    from tumblecal.cli.start import start
    from tumblecal.studies.threads import use_one_thread

    output.begin()
    use_one_thread()
    start()
    from tumblecal.data.joined import joined, runs_apart
    from tumblecal.data.joined_clocks import joined_clocks
    from tumblecal.data.overwriting import DIAGNOSIS, inputs_kept, others_kept
    from tumblecal.estimation.mountings import with_distinct_mounts
    from tumblecal.ground.atomic import output_folders

    inputs.check()
    if inputs.units and model.head is not None:
        raise InputError("--units measures the head anew, --head says what is known of it; give one of them")
    if inputs.units and len(data) < 2:
        raise InputError("--units: give the files of at least two units; one tells nothing of what they share")
    kept_out, allowed, raw = inputs.kept_out(), following.allowed(), inputs.raw(data, model.noise_sd)
    single = inputs.join or len(data) == 1
    batch = Batch(model, kept_out, raw, allowed, single, results, inputs.max_rows, output)
    batch.ready()
    folders = subfolders(data[:1] if inputs.join else data, out)
    read_or_kept = [*data, model.rig, model.head, inputs.samples, *model.effects, results.history]
    inputs_kept(read_or_kept, folders=[*folders, out], names=_WRITTEN)
    others_kept(DIAGNOSIS, [*folders, out])
    read = batch.read(data, together=single or inputs.units)
    if inputs.join:
        parts = [part for part in read if not isinstance(part, InputError)]
        parts = parts if model.rig else with_distinct_mounts(parts)
        parts = parts if inputs.same_run else runs_apart(parts)
        clocks = joined_clocks(parts, inputs.pause)
        whole = joined(parts, clocks)
        output.say("\n".join(filter(None, [_runs_in_words(parts, whole), *(clocks.words if clocks else ())])))
        batch.note = _ONE_MOUNTING if len(parts) > 1 and whole.mount is None else ""
        read, data = [whole], data[:1]
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


def _runs_in_words(parts: Sequence["PositionSet"], whole: "PositionSet") -> str:
    """How joined files are told apart; empty where a mounting each tells it."""
    if len(parts) < 2 or (whole.run is None and whole.mount is not None):
        return ""
    if whole.run is None:
        return f"The {len(parts)} files count as one run."
    runs = list(dict.fromkeys(whole.run))
    own = len(runs) == len(parts) and all(len(set(part.run or ())) == 1 for part in parts)
    whose = "each file a run of its own (--same-run takes them as one)" if own else "as their columns run say"
    return f"Runs: {', '.join(runs)}: {whose}."


def _diagnosed(
    batch: Batch,
    files: Sequence[Path],
    folders: Sequence[Path],
    read: Sequence["PositionSet | InputError"],
    workers: int | None,
    summary: Path,
) -> list[str]:
    """Diagnose the files, say what comes out as it comes, and write the summary of several; returns the faults."""
    from tumblecal.ground.result_set import remove_results
    from tumblecal.report.diagnosis_summary import write_summary

    faults: list[str] = []
    rows: list[dict] = []
    said = batch.output
    try:
        processes = processes_for(len(read)) if workers is None else workers
        if not batch.single:
            remove_results(summary.parent, (SUMMARY,))  # it is of the results as they are before the first is replaced
        outcomes = batch.run(files, folders, read, processes)
        for number, folder in enumerate(folders, start=1):
            with said.working(
                f"diagnosing {files[number - 1]}{f' ({number} of {len(files)})' if len(files) > 1 else ''}"
            ):
                row, refused, text = next(outcomes)
            rows.append(row)
            faults += refused
            if text:
                said.say(text if batch.single else f"{number} of {len(files)}  {text}")
            if not refused:
                said.record(folder / "diagnosis.json")
    finally:
        # An interrupted batch leaves the lines of what was finished.
        if not batch.single:
            write_summary(summary, rows)
    if not batch.single:
        said.say(f"written: {summary.parent}/: {summary.name}, a folder for each file")
    return faults
