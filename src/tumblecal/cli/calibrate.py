"""`tumblecal calibrate`: position files by all methods."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.cli.command import Command, add_to_history
from tumblecal.cli.options import ModelOptions, ResultOptions
from tumblecal.cli.position_files import JoinOptions, Outcome, PositionFiles
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.cli.position_files import Read

_SET = ("result.json", "calibration.json", "calibration.html", "residuals.svg", "methods.svg")


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
    from tumblecal.cli.model_options import StatedModel
    from tumblecal.data.overwriting import CALIBRATION
    from tumblecal.ground.atomic import output_folders
    from tumblecal.ground.result_set import result_set
    from tumblecal.lab.record import write_calibrated
    from tumblecal.lab.sensor_terms import lacking_of_fit
    from tumblecal.lab.summary import CALIBRATED, calibration_row
    from tumblecal.show.calibration import calibration_text, words_of_calibration

    files = PositionFiles(command, joining, more, data, out)
    model, figures = StatedModel.of(options), files.single if more.figures is None else more.figures

    def outcome(file: Path, folder: Path, positions: "Read") -> Outcome:
        try:
            if isinstance(positions, InputError):
                raise positions
            made = model.calibrated(positions)
        except InputError as fault:
            return Outcome(calibration_row(file, fault), fault.faults, f"{file}: refused")
        words = words_of_calibration(made, folder / "calibration.json")
        with result_set(folder, _SET) as aside:
            write_calibrated(aside, made, model.of_head(made.exact.problem))
            if figures:
                from tumblecal.show.figures.calibration import FIGURES, overview_figure
                from tumblecal.show.figures.drawing import write_each
                from tumblecal.show.page import write_page

                drawn = write_each(aside, FIGURES, made)
                write_page(aside / "calibration.html", words, {"overview": overview_figure, **drawn}, made.exact)
        add_to_history(more.history, folder, "calibration", made.exact.data.serial_number)
        command.warn(made.exact.data.source, words.lines("warnings"))
        row = calibration_row(file, made)
        lacking = "".join(f" ({loss})" for loss in lacking_of_fit(made.exact, made.entries, of_sensor=True))
        text = calibration_text(words, command.columns)
        return Outcome(row, (), f"{file}: {row['judgement']}{lacking}", partial(command.say, text), made.use.refused)

    read = files.read(model, options, CALIBRATION, _SET)
    with output_folders([out]):
        outcomes = map(outcome, files.files, files.folders, read)
        return files.conclude(outcomes, CALIBRATED, _SET, "result.json", "calibrating")
