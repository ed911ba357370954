"""Kind of a file of tumblecal by its beginning, for a message if it is given in place of a different one."""

import contextlib
import re
from collections.abc import Sequence
from pathlib import Path

from tumblecal.ground.errors import InputError


CALIBRATION_KIND = "a calibration"
_KINDS = {
    "calibration": CALIBRATION_KIND,
    "result": "the result of a calibration",
    "diagnosis": "a diagnosis",
    "check": "the result of a check",
    "plan": "a plan",
    "rig": "a rig file",
}
_SCHEMA = re.compile(r"""["']?schema["']?\s*[:=]\s*["']tumblecal\.(\w+)/""")
_BEGINNING = 65536


def kind_of(path: Path) -> str:
    """What a file of tumblecal is, in words; empty for every other file, and for one that cannot be read."""
    beginning = b""
    with contextlib.suppress(OSError):
        if path.is_file():
            with path.open("rb") as file:
                beginning = file.read(_BEGINNING)
    is_toml = path.suffix.lower() == ".toml"
    if not is_toml and not beginning.lstrip().startswith(b"{"):
        return ""
    found = _SCHEMA.search(beginning.decode("utf-8", errors="replace"))
    if found is None:
        return "a TOML file" if is_toml else ""
    return _KINDS.get(found[1], f"a file of the kind tumblecal.{found[1]}")


def require_calibration_and_recording(calibration: Path, recording: Sequence[Path]) -> None:
    """Reject a calibration in place of a recording, and other files of tumblecal in place of both.

    **Raises:** `InputError` with one line.
    """
    if (kind := kind_of(calibration)) not in ("", CALIBRATION_KIND):
        raise InputError(
            f"{calibration}: this is {kind}, not a calibration; give the calibration.json of calibrate, diagnose or thermal"
        )
    for path in recording:
        if kind := kind_of(path):
            raise InputError(
                f"{path}: this is {kind}, not a recording; give the calibration first, then attitudes at rest: a log, a "
                "position file (positions.csv), or a folder of tumblecal capture"
            )
