"""`tumblecal compare`: what moved between two calibrations."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.cli.output import Quiet


if TYPE_CHECKING:
    from tumblecal.data.calibration import Calibration
    from tumblecal.data.sensor_parameters import SensorParameters


def compare(old: str, new: str, /, *, quiet: Quiet = False) -> None:
    """Say what moved between two calibrations of a unit, in standard deviations, and what would have moved it.

    Parameters
    ----------
    old
        A calibration.json; or FORMAT:FILE as export knows them, such as px4:factory.params.
    new
        The later one.
    """
    from tumblecal.data.noise_dof import with_dof_beside
    from tumblecal.devices import read_any
    from tumblecal.ground.gravity import STANDARD
    from tumblecal.history.comparison import compare as compared
    from tumblecal.report.history_words import comparison_text

    second = read_any(new)
    gravity = (second.gravity or STANDARD).value_ms2
    first = read_any(old, gravity)
    if "format" in second.provenance:
        second = read_any(new, (first.gravity or STANDARD).value_ms2)
    first, second = (with_dof_beside(Path(given), own) for given, own in ((old, first), (new, second)))
    both, held = zip(*(_sensor(*pair) for pair in ((old, first), (new, second))), strict=True)
    print(comparison_text(compared(*both)))
    for warning in _warnings(old, first, new, second):
        print(f"WARNING: {warning}", file=sys.stderr)
    print("\n".join(held))


def _sensor(given: str, own: "Calibration") -> "tuple[SensorParameters, str]":
    """A calibration's parameters, and what their uncertainty holds."""
    from tumblecal.data.budget_result import NAME, with_budget_beside
    from tumblecal.data.not_applied import losses_words
    from tumblecal.data.uncertainty_parts import held_words
    from tumblecal.devices import TARGETS
    from tumblecal.report.history_words import dof_words

    if name := own.provenance.get("format"):
        target = TARGETS[name]
        lacks = " and no ".join(target.lacks)
        said = f"; {name} has no {lacks}: left out of table and tests" if lacks else ""
        return target.stated(own), f"{given}: its uncertainty is not known and counts as none{said}"
    words = own.sensor.undetermined_words
    use = "".join([f"\n{given}: {words}" for words in (f"use: {own.use.words}", *losses_words(own.not_applied))])
    undetermined = f"; its data did not determine {words}" if words else ""
    undetermined += dof_words(own.sensor.dof)
    if budgeted := with_budget_beside(Path(given), own):
        return (
            budgeted,
            f"{given}: its uncertainty is combined, of {held_words(own, NAME)} in its folder{undetermined}{use}",
        )
    return own.sensor, f"{given}: its uncertainty is of {held_words(own)}{undetermined}{use}"


def _warnings(old: str, first: "Calibration", new: str, second: "Calibration") -> list[str]:
    """What makes two calibrations no fair comparison."""
    said = []
    if first.serial_number and second.serial_number and first.serial_number != second.serial_number:
        said.append(f"{old} is of unit {first.serial_number}, {new} of {second.serial_number}")
    digests = first.provenance.get("sha256"), second.provenance.get("sha256")
    if digests[0] and digests[0] == digests[1]:
        said.append("both were made from the same data: their errors are not independent, the tests do not hold")
    said += [f"{file}: use: {own.use.words}" for file, own in ((old, first), (new, second)) if own.use.refused]
    if first.extra.get("terms") or second.extra.get("terms"):
        said.append("nonlinear and thermal terms are not compared")
    before, after = first.gravity, second.gravity
    if before and after and before.value_ms2 != after.value_ms2:
        ratio = after.value_ms2 / before.value_ms2 - 1
        said.append(
            f"gravity was {before.value_ms2:.6g}, then {after.value_ms2:.6g} m/s^2: if that is one place, its new value alone "
            f"moves all scale factors of readings in m/s^2 by {-ratio:.2g}; if two, the place moves those of readings in g by "
            f"{ratio:+.2g}"
        )
    return said
