"""`tumblecal diagnose`."""

from pathlib import Path

from tumblecal.cli.command import Command
from tumblecal.cli.diagnosis_batch import DIAGNOSIS_SET, UNITS_SET, Batch
from tumblecal.cli.input_options import InputOptions
from tumblecal.cli.model_options import ModelOptions
from tumblecal.cli.next_positions import NextPositions
from tumblecal.cli.options import ResultOptions
from tumblecal.cli.position_files import JoinOptions, PositionFiles


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
    from tumblecal.lab.summary import DIAGNOSED
    from tumblecal.recordings.dwells.by_columns import read_position_samples

    files = PositionFiles(command, joining, more, data, out)
    inputs.require(model, files)
    raw = None if inputs.samples is None else read_position_samples(inputs.samples)
    batch = Batch(model, inputs.held_out(), raw, following.allowed(), files.single, more, inputs.max_rows, command)
    stated = batch.model
    files.protect(model, DIAGNOSIS, (*DIAGNOSIS_SET, *UNITS_SET), inputs.samples)
    read = read_each(files, stated, together=inputs.units, check_size=False, sampled=raw is not None)
    with output_folders(files.folders, out):
        if inputs.units:
            return diagnosed_units(files, batch, read, inputs.workers)
        outcomes = diagnosed_files(batch, files, read, inputs.workers, [stated.head] * len(read))
        return conclude(files, outcomes, DIAGNOSED, DIAGNOSIS_SET, "diagnosis.json", "diagnosing")
