"""Formats of other programs and devices: one entry for each target, in the file of its family.

`TARGETS` has the `Target` of each name that `tumblecal export --to` accepts.

Examples:
    >>> import numpy as np
    >>> from tumblecal.data import Calibration
    >>> from tumblecal.devices import TARGETS, Export
    >>> export = Export(Calibration(np.eye(3), np.array([0.001, 0.0, 0.0]), np.zeros((12, 12))), gravity_ms2=9.81)
    >>> print(TARGETS["ardupilot"].write(export).splitlines()[0])
    INS_ACCOFFS_X,0.00980999973
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_file import require_triad
from tumblecal.data.result_records import read_checked
from tumblecal.devices import c_header, own_formats, parameter_files, text_formats
from tumblecal.devices.format_losses import Loss, losses
from tumblecal.devices.target import Export, Target
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2
from tumblecal.ground.strict_json import LARGEST
from tumblecal.ground.text_file import read_text


_FAMILIES = (c_header, own_formats, parameter_files, text_formats)
TARGETS: dict[str, Target] = {target.name: target for family in _FAMILIES for target in family.TARGETS}

__all__ = ["TARGETS", "Export", "Loss", "Target", "losses", "read_any"]


def read_any(given: str, gravity_ms2: float = STANDARD_GRAVITY_MS2) -> Calibration:
    """A calibration file, or with `FORMAT:` before its name one of a target, such as `px4:factory.params`.

    **Arguments:**

    - `gravity_ms2`: one g, by which a bias in m/s^2 is divided.

    **Returns:** the calibration; from the file of a target with a covariance of zeros (unknown) and `provenance["format"]`.

    **Raises:** `InputError` if it cannot be read.

    Examples:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from tumblecal.devices import read_any
        >>> with TemporaryDirectory() as folder:
        ...     _ = Path(folder, "A.txt").write_text("A = [1.001 0 0; 0 1 0; 0 0 1];\\nb = [0 0 -0.0098];\\n")
        ...     calibration = read_any(f"matlab:{folder}/A.txt", gravity_ms2=9.8)
        >>> calibration.matrix.diagonal().tolist(), calibration.bias.round(6).tolist()
        ([1.001, 1.0, 1.0], [0.0, 0.0, 0.001])
    """
    name, colon, file = given.partition(":")
    if not colon or (name not in TARGETS and Path(given).exists()):
        return read_checked(Path(given))
    if name not in TARGETS:
        raise InputError(f"{given}: no format {name!r}; formats: {', '.join(TARGETS)}")
    if not file:
        raise InputError(f"{given}: no file after the colon; write {name}:FILE")
    path = Path(file)
    try:
        read = TARGETS[name].read(read_text(path, name), gravity_ms2)
        if not (np.all(np.abs(read.matrix) <= LARGEST) and np.all(np.abs(read.bias) <= LARGEST)):
            raise InputError(f"numbers that are not finite, or beyond {LARGEST:g}; correct the file")
        require_triad(read.matrix)
    except InputError as fault:
        raise InputError([f if f.startswith(f"{path}:") else f"{path}: {f}" for f in fault.faults]) from fault
    return replace(read, provenance={"data": str(path), "format": name})
