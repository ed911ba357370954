"""`tumblecal calibrate`: position files by all methods."""

from functools import partial
from pathlib import Path

from tumblecal.cli.command import Command
from tumblecal.cli.model_options import ModelOptions
from tumblecal.cli.options import ResultOptions
from tumblecal.cli.position_files import JoinOptions, PositionFiles


def calibrate(
    data: list[Path],
    /,
    *,
    options: ModelOptions = ModelOptions(),
    joining: JoinOptions = JoinOptions(),
    out: Path = Path("calibration"),
    more: ResultOptions = ResultOptions(),
    command: Command = Command(),
) -> int:
    """Calibrate position files by the exact method and all linear methods.

    Exit code: 0; 2 for input that is rejected; 3 if a calibration must not be used (`use: no`), with all files written.

    Parameters
    ----------
    data
        Position files (.csv or .parquet). Several files are a batch: each has a subfolder, and a faulty file is skipped. With
        --join they are one measurement.
    out
        Output folder: result.json, calibration.json, figures, calibration.html (all results) and, for a batch, summary.csv.
        A folder with results of diagnose is rejected. Example: --out unit17.
    """
    command.begin()
    from tumblecal.cli.calibrated_file import SET, calibrated_file
    from tumblecal.cli.outcomes import conclude
    from tumblecal.cli.positions_read import read_each
    from tumblecal.cli.read_model import read_model
    from tumblecal.data.overwriting import CALIBRATION
    from tumblecal.ground.atomic import output_folders
    from tumblecal.lab.summary import CALIBRATED

    files, model = PositionFiles(command, joining, more, data, out), read_model(options)
    files.protect(options, CALIBRATION, SET)
    read = read_each(files, model)
    with output_folders([out]):
        outcomes = map(partial(calibrated_file, files, model), files.files, files.folders, read)
        return conclude(files, outcomes, CALIBRATED, SET, "result.json", "calibrating")
