"""`tumblecal compare`: changes between two calibrations."""

from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.cli.options import Quiet
from tumblecal.cli.terminal import print_folded, warn


if TYPE_CHECKING:
    from tumblecal.data.calibration import Calibration
    from tumblecal.data.sensor_parameters import SensorParameters


def compare(old: str, new: str, /, *, quiet: Quiet = False) -> None:
    """Compare two calibrations of a unit: changes in standard uncertainties, and their possible causes.

    Parameters
    ----------
    old
        The earlier calibration.json; or FORMAT:FILE with a format of export, such as px4:factory.params.
    new
        The later one, in the same forms.
    """
    from tumblecal.devices import read_any
    from tumblecal.ground.gravity import STANDARD
    from tumblecal.history.comparison import common_temperature
    from tumblecal.history.comparison import compare as compared
    from tumblecal.show.comparison import comparison_tables

    # The bias of a format in m/s^2 is divided by the gravity of the other file.
    second = read_any(new, (read_any(old).gravity or STANDARD).value_ms2)
    first = read_any(old, (second.gravity or STANDARD).value_ms2)
    degc = common_temperature(first, second)
    (before, before_note), (after, after_note) = _sensor(old, first, degc), _sensor(new, second, degc)
    changes, tests = comparison_tables(compared(before, after))
    print_folded(changes, "", tests)
    serials, digests = {first.serial_number, second.serial_number} - {None, ""}, first.provenance.get("sha256")
    if len(serials) > 1:
        warn(old, [f"is of unit {first.serial_number}, but {new} is of {second.serial_number}"])
    if digests and digests == second.provenance.get("sha256"):
        warn(old, [f"is from the same data as {new}: their errors are not independent, and the tests are not valid"])
    for given, calibration in ((old, first), (new, second)):
        warn(given, [f"use: {calibration.use.words}"] if calibration.use.refused else [])
        warn(given, ["its nonlinear and thermal terms are not compared"] if calibration.terms else [])
    if first.gravity and second.gravity and (ratio := second.gravity.value_ms2 / first.gravity.value_ms2 - 1):
        words = (
            f"gravity changed from {first.gravity.value_ms2:.6g} to {second.gravity.value_ms2:.6g} m/s^2. If the site is the "
            f"same, the new value changes all scale factors of readings in m/s^2 by {-ratio:.2g}; if it is not, the site "
            f"changes those of readings in g by {ratio:+.2g}"
        )
        warn(new, [words])
    if degc is not None:
        print_folded(f"both at {degc:.4g} degC; the dependence on temperature is not compared")
    print_folded(f"{before_note}\n{after_note}")


def _sensor(given: str, calibration: "Calibration", degc: float | None) -> "tuple[SensorParameters, str]":
    """The parameters of a calibration, at this temperature if they follow it, and a note on the parts of their uncertainty."""
    from tumblecal.data.budget_result import NAME, with_budget_in_folder
    from tumblecal.data.not_applied import use_lines
    from tumblecal.data.uncertainty_parts import contribution_words
    from tumblecal.devices import TARGETS
    from tumblecal.show.comparison import dof_words

    at_degc = calibration if degc is None else calibration.at(degc)
    if name := calibration.provenance.get("format"):
        lacks = " and no ".join(TARGETS[name].lacks)
        omitted = f"; {name} has no {lacks}: not in table and tests" if lacks else ""
        words = f"{given}: its uncertainty is unknown and is assumed to be zero{omitted}"
        return TARGETS[name].stated(at_degc), words
    budgeted = with_budget_in_folder(Path(given), calibration, degc)
    parts = contribution_words(calibration, NAME if budgeted else "")
    undetermined = calibration.sensor.undetermined_words
    note = (
        f"combined standard uncertainty of {parts} in its folder" if budgeted else f"its uncertainty includes {parts}"
    )
    note += f"; its data did not determine {undetermined}" if undetermined else ""
    note += dof_words(calibration.sensor.dof)
    return budgeted or at_degc.sensor, "\n".join(f"{given}: {line}" for line in [note, *use_lines(calibration)])
