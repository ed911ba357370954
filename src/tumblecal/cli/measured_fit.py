"""The exact fit of a position file, for a command that continues with it; what was noticed is printed."""

from pathlib import Path

from tumblecal.cli.command import Command
from tumblecal.cli.terminal import warn
from tumblecal.data.position_notes import position_notes
from tumblecal.estimation import Fit
from tumblecal.estimation.stated_model import StatedModel
from tumblecal.ground.errors import InputError
from tumblecal.ground.suggested_command import suggested
from tumblecal.show.calibration import words_of_calibration


def measured_fit(command: Command, model: StatedModel, path: Path) -> tuple[Fit, list[str]]:
    """The fit of a file, and reservations about it.

    **Raises:** `InputError` for positions that cannot be fitted.
    """
    positions = model.read(path)
    warn(path, [*position_notes(positions), *model.notes(positions)])
    calibrated = model.calibrated(positions)
    notes = words_of_calibration(calibrated).lines("warnings")
    command.say(*notes)
    command.warn(path, notes)
    if not calibrated.exact.code.good:
        raise InputError(f"{path}: {calibrated.exact.message}; run: {suggested('diagnose', path)}")
    return calibrated.exact, notes
