"""The still attitudes of a recording, for a check: every format that `reduce` reads, position files, and captures."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from tumblecal.capture.journal import sha256_of
from tumblecal.data.calibration import Calibration
from tumblecal.data.position_comments import MEASURED
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions
from tumblecal.recordings.own_tables import with_context
from tumblecal.recordings.reduce import positions_or_rest
from tumblecal.recordings.reduction import Reduction
from tumblecal.recordings.still.intervals import grouped


# Fewer directions need a log of at least this length, s.
_FEWEST, _LONG_S = 3, 60.0


def provenance(found: Reduction, path: Path, calibration: Calibration) -> dict[str, Any]:
    """Files of a check with their SHA-256, and the date of the recording, if stated; `path`: of the calibration.

    **Raises:** `InputError` for a recording from which the calibration was made.
    """
    digests = {str(file): sha256_of(file) if file.is_file() else None for file in found.dwells.files}
    made_from = calibration.provenance.get("sha256", "")
    if used := [file for file, digest in digests.items() if digest == made_from]:
        raise InputError(f"{used[0]}: {path} was made from this file; check it with a new recording")
    return {
        "calibration": {"file": str(path), "sha256": sha256_of(path)},
        "recording": [{"file": file, "sha256": digest} for file, digest in digests.items()],
        "measured_utc": found.data.comments.get(MEASURED),
    }


def directions_of(found: Reduction) -> int:
    """Number of different directions of gravity."""
    return len(grouped(found.data.readings)[1])


def still_attitudes(
    files: list[Path], context: KnownContext, options: RecordingOptions, criterion: Criterion
) -> Reduction:
    """Read the still attitudes of a recording.

    **Arguments:**

    - `files`: one recording, or several files of one. Others as for `reduce`; attitudes that are not stated are unknown.

    **Raises:** `InputError` for a recording that cannot be read, has no interval at rest, or too few attitudes.
    """
    found = positions_or_rest(files, context, options, criterion)
    # Readings in m/s^2, and those of a capture, were divided by the gravity of the recording.
    in_ms2 = found.data.in_ms2 or any(recording.layout.unit == "ms2" for recording in found.dwells.read)
    data = replace(found.data, in_ms2=in_ms2 or "captured_in" in found.data.comments)
    found = replace(found, data=with_context(data, context))
    still_s = found.dwells.still_s
    if directions_of(found) < _FEWEST and (still_s or 0.0) < _LONG_S:
        known = "" if still_s is None else f", {still_s:.3g} s at rest"
        raise InputError(
            f"{data.source}: only {counted(directions_of(found), 'attitude')}{known}; a check needs three or more attitudes, "
            f"or one log of {_LONG_S:g} s at rest"
        )
    return found
