"""One position file of `tumblecal calibrate`: its calibration, and its results."""

from functools import partial
from pathlib import Path

from tumblecal.cli.outcomes import Outcome
from tumblecal.cli.position_files import PositionFiles
from tumblecal.cli.positions_read import Read
from tumblecal.cli.result_files import add_to_history
from tumblecal.cli.terminal import columns
from tumblecal.estimation.stated_model import StatedModel
from tumblecal.ground.errors import InputError
from tumblecal.ground.result_set import result_set
from tumblecal.lab.record import write_calibrated, written_calibration
from tumblecal.lab.summary import calibration_row
from tumblecal.lab.terms import lacking_words
from tumblecal.show.calibration import calibration_text, words_of_calibration


SET = ("result.json", "calibration.json", "calibration.html", "residuals.svg", "methods.svg")


def calibrated_file(files: PositionFiles, model: StatedModel, file: Path, folder: Path, read: Read) -> Outcome:
    """Calibrate one file, and write its results."""
    try:
        if isinstance(read, InputError):
            raise read
        made = model.calibrated(read)
    except InputError as fault:
        return Outcome(calibration_row(file, fault), fault.faults, f"{file}: refused")
    command, more, data = files.command, files.more, made.exact.data
    words = words_of_calibration(made, folder / "calibration.json")
    with result_set(folder, SET) as aside:
        write_calibrated(aside, made, model.of_head(made.exact.problem))
        if files.single if more.figures is None else more.figures:
            from tumblecal.show.figures.calibration import FIGURES, overview_figure
            from tumblecal.show.figures.drawing import write_each
            from tumblecal.show.page import write_page

            drawn = write_each(aside, FIGURES, made)
            write_page(aside / "calibration.html", words, {"overview": overview_figure, **drawn}, made.exact)
    add_to_history(more.history, folder, "calibration", data.serial_number)
    command.warn(data.source, words.lines("warnings"))
    row, text = calibration_row(file, made), calibration_text(words, columns())
    lacking = "".join(f" ({loss})" for loss in lacking_words(written_calibration(made), of_sensor=True))
    return Outcome(row, (), f"{file}: {row['judgement']}{lacking}", partial(command.say, text), made.use.refused)
