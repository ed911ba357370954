"""`tumblecal compare`: changes between two calibrations."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.cli.output import Quiet


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
    from tumblecal.show.comparison import comparison_text

    second = read_any(new)
    gravity = (second.gravity or STANDARD).value_ms2
    first = read_any(old, gravity)
    if "format" in second.provenance:
        second = read_any(new, (first.gravity or STANDARD).value_ms2)
    degc = common_temperature(first, second)
    both, notes = zip(*(_sensor(*pair, degc) for pair in ((old, first), (new, second))), strict=True)
    print(comparison_text(compared(*both)))
    for warning in _warnings(old, first, new, second):
        print(f"WARNING: {warning}", file=sys.stderr)
    if degc is not None:
        print(f"both at {degc:.4g} degC; the dependence on temperature is not compared")
    print("\n".join(notes))


def _sensor(given: str, calibration: "Calibration", degc: float | None) -> "tuple[SensorParameters, str]":
    """The parameters of a calibration, at this temperature if they follow it, and a note on the parts of their uncertainty."""
    from tumblecal.data.budget_result import NAME, with_budget_in_folder
    from tumblecal.data.not_applied import losses_words
    from tumblecal.data.uncertainty_parts import contribution_words
    from tumblecal.devices import TARGETS
    from tumblecal.show.comparison import dof_words

    if name := calibration.provenance.get("format"):
        target = TARGETS[name]
        lacks = " and no ".join(target.lacks)
        omitted = f"; {name} has no {lacks}: not in table and tests" if lacks else ""
        own = calibration if degc is None else calibration.at(degc)
        return target.stated(own), f"{given}: its uncertainty is unknown and is assumed to be zero{omitted}"
    words = calibration.sensor.undetermined_words
    notes = (f"use: {calibration.use.words}", *losses_words(calibration.not_applied))
    use = "".join([f"\n{given}: {note}" for note in notes])
    undetermined = f"; its data did not determine {words}" if words else ""
    undetermined += dof_words(calibration.sensor.dof)
    if budgeted := with_budget_in_folder(Path(given), calibration, degc):
        parts = contribution_words(calibration, NAME)
        return budgeted, f"{given}: combined standard uncertainty of {parts} in its folder{undetermined}{use}"
    sensor = calibration.sensor if degc is None else calibration.at(degc).sensor
    return sensor, f"{given}: its uncertainty includes {contribution_words(calibration)}{undetermined}{use}"


def _warnings(old: str, first: "Calibration", new: str, second: "Calibration") -> list[str]:
    """Warnings on a comparison of two calibrations that is not valid as it is."""
    warnings = []
    if first.serial_number and second.serial_number and first.serial_number != second.serial_number:
        warnings.append(f"{old} is of unit {first.serial_number}, {new} of {second.serial_number}")
    digests = first.provenance.get("sha256"), second.provenance.get("sha256")
    if digests[0] and digests[0] == digests[1]:
        warnings.append("both are from the same data: their errors are not independent, and the tests are not valid")
    pairs = ((old, first), (new, second))
    warnings += [f"{file}: use: {calibration.use.words}" for file, calibration in pairs if calibration.use.refused]
    if first.extra.get("terms") or second.extra.get("terms"):
        warnings.append("nonlinear and thermal terms are not compared")
    before, after = first.gravity, second.gravity
    if before and after and before.value_ms2 != after.value_ms2:
        ratio = after.value_ms2 / before.value_ms2 - 1
        warnings.append(
            f"gravity changed from {before.value_ms2:.6g} to {after.value_ms2:.6g} m/s^2. If the site is the same, the new "
            f"value changes all scale factors of readings in m/s^2 by {-ratio:.2g}; if it is not, the site changes those of "
            f"readings in g by {ratio:+.2g}"
        )
    return warnings
