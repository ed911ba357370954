"""A check of a calibration by the still attitudes of a recording."""

from pathlib import Path
from typing import Any

from tumblecal.check.attitudes import provenance
from tumblecal.check.gravity import local_size
from tumblecal.check.result import CheckResult, Model, check
from tumblecal.data.calibration import Calibration
from tumblecal.data.positions import PositionSet
from tumblecal.estimation.stated_model import StatedModel
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import Gravity
from tumblecal.recordings.reduction import Reduction


def check_recording(
    calibration: Calibration,
    path: Path,
    found: Reduction,
    stated: StatedModel,
    *,
    local: Gravity | None = None,
    u_gravity: float | None = None,
    other_unit: bool = False,
    **options: Any,
) -> tuple[CheckResult, dict[str, Any]]:
    """Check a calibration by a recording.

    **Arguments:**

    - `path`: of the calibration. `found`: as from `still_attitudes`. `stated`: the model of known angles.
    - `local`, `u_gravity`: gravity at the place of the recording and its relative standard uncertainty, as of `local_size`.
    - `other_unit`: whether the recording may be of a different unit. `options`: of `check`.

    **Returns:** the check, and its provenance.

    **Raises:** `InputError` as `check`; for a recording of a different unit, or from which the calibration was made.
    """
    source, serial = provenance(found, path, calibration), found.data.serial_number or calibration.serial_number
    calibration.require_unit(path, found.data.source, serial, other=other_unit)
    gravity, data = local_size(calibration, found.data, local, u_gravity, str(path))
    return check(calibration, path, data, model=_model(stated, data), gravity=gravity, **options), source


def _model(stated: StatedModel, data: PositionSet) -> Model:
    """The model of known angles.

    **Raises:** `InputError` for angles that are stated, but unknown.
    """
    if stated.rig is None and not stated.priors:
        return Model()
    if data.hand_held:
        option = "--rig" if stated.rig else "--prior"
        raise InputError(
            f"{option}: the angles of {data.source} are unknown; omit it, or give angles (--plan, --table)"
        )
    return Model(lambda data: stated.chain(data, known=True), stated.priors)
