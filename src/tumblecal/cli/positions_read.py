"""The positions of the files of one call: read, joined if asked for, or fitted; what was noticed is printed."""

from pathlib import Path

from tumblecal.cli.command import Command
from tumblecal.cli.position_files import PositionFiles
from tumblecal.cli.terminal import warn
from tumblecal.data import PositionSet
from tumblecal.data.overwriting import given_once
from tumblecal.data.repeats import position_notes
from tumblecal.estimation import Fit
from tumblecal.estimation.stated_model import StatedModel
from tumblecal.ground.errors import InputError
from tumblecal.ground.suggested_command import suggested
from tumblecal.show.calibration import words_of_calibration


# Positions, or the fault of their file.
Read = PositionSet | InputError


def read_each(
    files: PositionFiles, model: StatedModel, *, together: bool = False, check_size: bool = True, sampled: bool = False
) -> list[Read]:
    """The positions of each file, or of all files joined; in a batch, the fault of each file that cannot be read.

    **Arguments:**

    - `together`: whether a file that cannot be read ends the command, as it does for a single measurement.
    - `check_size`: of the readings. `sampled`: whether raw samples state the noise.

    **Raises:** `InputError`.
    """
    for path, copied in given_once(files.given).items():
        warn(path, [copied])
    read = list[Read]()
    for path in files.given:
        try:
            positions = model.read(path, check_size=check_size, one_of_several=len(files.given) > 1)
            warn(path, position_notes(positions))
            read.append(positions)
        except InputError as fault:
            if together or files.single:
                raise
            read.append(fault)
    if files.joining.join:
        from tumblecal.estimation.joined_files import joined_files

        parts = [part for part in read if not isinstance(part, InputError)]
        whole, words = joined_files(parts, model.rig, files.joining.pause, same_run=files.joining.same_run)
        files.command.say(*words)
        read[:] = [whole]
    for positions in read:
        if not isinstance(positions, InputError):
            warn(positions.source, model.notes(positions, sampled=sampled))
    return read


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
