"""`tumblecal diagnose`."""

from pathlib import Path
from typing import Annotated

from tumblecal.cli.command import Command
from tumblecal.cli.diagnosis_batch import DIAGNOSIS_SET, UNITS_SET, Batch
from tumblecal.cli.model_options import ModelOptions
from tumblecal.cli.next_positions import NextPositions
from tumblecal.cli.options import Count, ResultOptions, options, within
from tumblecal.cli.position_files import JoinOptions, PositionFiles
from tumblecal.ground.errors import InputError


@options
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
    workers: Count | None = None
    max_rows: Annotated[int | None, within(gte=3)] = None

    def require(self, model: ModelOptions, files: PositionFiles) -> None:
        """Check that the options fit together.

        **Raises:** `InputError`.
        """
        if self.units and (files.joining.join or model.head is not None):
            raise InputError(
                "--units treats each file as a different triad on a head of unknown errors; give it without --join and --head"
            )
        if self.units and files.single:
            raise InputError("--units: only one file; give the files of at least two units to find their common errors")
        if self.samples is not None and model.noise_sd is not None:
            raise InputError("--samples and --noise-sd both state the noise; give only one of these options")
        if self.samples is not None and not files.single:
            raise InputError("--samples is for one position file, but several are given; diagnose each file separately")


def diagnose(
    data: list[Path],
    /,
    *,
    model: ModelOptions = ModelOptions(),
    out: Path = Path("diagnosis"),
    inputs: InputOptions = InputOptions(),
    joining: JoinOptions = JoinOptions(),
    following: NextPositions = NextPositions(),
    more: ResultOptions = ResultOptions(),
    command: Command = Command(),
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
    command.begin(one_thread=True)
    from tumblecal.cli.diagnosed_units import diagnosed_units
    from tumblecal.cli.diagnosis_workers import diagnosed_files
    from tumblecal.cli.outcomes import conclude
    from tumblecal.cli.positions_read import read_each
    from tumblecal.data.overwriting import DIAGNOSIS
    from tumblecal.ground.atomic import output_folders
    from tumblecal.ground.option_texts import pairs
    from tumblecal.lab.summary import DIAGNOSED
    from tumblecal.recordings.dwells.position_samples import read_position_samples

    files = PositionFiles(command, joining, more, data, out)
    inputs.require(model, files)
    held_out = next(iter(pairs("--holdout", [inputs.holdout or ""], "run=3").items()), None)
    raw = None if inputs.samples is None else read_position_samples(inputs.samples)
    batch = Batch(model, held_out, raw, following.allowed(), files.single, more, inputs.max_rows, command)
    stated = batch.model
    files.protect(model, DIAGNOSIS, (*DIAGNOSIS_SET, *UNITS_SET), inputs.samples)
    read = read_each(files, stated, together=inputs.units, check_size=False, sampled=raw is not None)
    with output_folders(files.folders, out):
        if inputs.units:
            return diagnosed_units(files, batch, read, inputs.workers)
        outcomes = diagnosed_files(batch, files, read, inputs.workers, [stated.head] * len(read))
        return conclude(files, outcomes, DIAGNOSED, DIAGNOSIS_SET, "diagnosis.json", "diagnosing")
