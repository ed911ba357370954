"""Gravity at the place of a check, in g of the calibration."""

from dataclasses import dataclass, field

from tumblecal.data.calibration import Calibration
from tumblecal.data.positions import PositionSet
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import SAME_MS2, Gravity
from tumblecal.words import sentence


# Gravity by latitude and height differs from the real one by anomalies of this standard deviation, relative (30 mGal).
_ANOMALY = 3e-5
_NORMAL = "normal gravity"


@dataclass(frozen=True)
class LocalSize:
    """Ratio of gravity at the place of a check to that of the calibration, its standard uncertainty, and both in words;
    `unknown`: whether only one of the two is stated."""

    ratio: float = 1.0
    u: float = 0.0
    words: str = field(default_factory=lambda: sentence("check/gravity", c=None, d=None))
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
        words = sentence("check/gravity", c=None, d=of_data)
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
        stated = None if of_data is None or of_data.assumed else of_data
        return LocalSize(1.0, sd or 0.0, sentence("check/gravity", c=of_calibration, d=stated)), data
    normal = [each.source.startswith(_NORMAL) for each in (local, of_calibration)]
    same = local.value_ms2 == of_calibration.value_ms2
    usual = 0.0 if same else _ANOMALY * (sum(normal) ** 0.5)
    return LocalSize(local.in_g_of(of_calibration), usual if sd is None else sd, str(local)), data
