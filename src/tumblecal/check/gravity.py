"""Gravity at the place of a check, in g of the calibration."""

from dataclasses import dataclass

from tumblecal.data.calibration import Calibration
from tumblecal.data.positions import PositionSet
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import SAME_MS2, Gravity


# Gravity by latitude and height differs from the real one by anomalies of this standard deviation, relative (30 mGal).
_ANOMALY = 3e-5
_NORMAL = "normal gravity"


@dataclass(frozen=True)
class LocalSize:
    """Ratio of gravity at the place of a check to that of the calibration, its standard uncertainty, and both in words;
    `unknown`: whether only one of the two is stated."""

    ratio: float = 1.0
    u: float = 0.0
    words: str = "neither file states it, so both are taken to be the same"
    unknown: bool = False


def local_size(
    calibration: Calibration, data: PositionSet, local: Gravity | None, sd: float | None, named: str
) -> tuple[LocalSize, PositionSet]:
    """The size of gravity at the place of a recording, and its readings in the unit of the calibration.

    Readings in m/s^2 were divided by the gravity of the recording. The unit of the calibration is its own gravity.

    **Arguments:**

    - `local`: gravity of --gravity; by default that of the recording. `sd`: its relative standard uncertainty, as stated.
    - `named`: the calibration file.

    **Raises:** `InputError` for a recording that states a different gravity from that of the calibration, without `local`.
    """
    of_calibration, of_data = calibration.gravity, data.gravity
    if of_calibration is None:
        if local is not None and sd is None:
            raise InputError(
                f"{named}: no gravity is stated, so it cannot be compared with --gravity; calibrate with --gravity"
            )
        if of_data is None or of_data.assumed:
            return LocalSize(1.0, sd or 0.0), data
        words = f"the recording is at {of_data}, the calibration states none; calibrate with --gravity"
        return LocalSize(1.0, sd or 0.0, words, unknown=True), data
    if data.in_ms2:
        data = data.under(of_calibration)
    differs = of_data is not None and abs(of_data.value_ms2 - of_calibration.value_ms2) > SAME_MS2
    if local is None and of_data is not None and differs and not of_data.assumed:
        raise InputError(
            f"{data.source}: gravity {of_data}, but that of {named} is {of_calibration}; to check at this place: "
            f"--gravity {of_data.value_ms2:.6g}"
        )
    if local is None:
        stated = (
            "as in the calibration"
            if of_data and not of_data.assumed
            else "taken from the calibration, as the recording states none"
        )
        return LocalSize(1.0, sd or 0.0, f"{of_calibration}, {stated}"), data
    normal = [each.source.startswith(_NORMAL) for each in (local, of_calibration)]
    same = local.value_ms2 == of_calibration.value_ms2
    usual = 0.0 if same else _ANOMALY * (sum(normal) ** 0.5)
    return LocalSize(local.in_g_of(of_calibration), usual if sd is None else sd, str(local)), data
