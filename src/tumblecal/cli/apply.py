"""`tumblecal apply`: corrected data."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter


if TYPE_CHECKING:
    from tumblecal.data.calibration import Calibration
    from tumblecal.data.raw import Raw


# Gravity alone was measured: farther out than this (g) what is not linear is extrapolated.
_FAR_G = 2.0
# Readings at rest in m/s^2 under columns that say g have this size.
_LIKE_MS2 = (8.0, 11.6)


def apply(
    calibration: Path,
    raw: Path,
    /,
    *,
    out: Path | None = None,
    gravity: Annotated[str | None, Parameter(show_default=False)] = None,
    other_unit: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """Correct raw readings by a calibration file: f = matrix (A - bias), and its nonlinear and thermal terms if it has any.

    Parameters
    ----------
    calibration
        The calibration.json that calibrate or diagnose wrote.
    raw
        The readings, .csv or .parquet, with columns ax_g, ay_g, az_g (or _mg, _ms2); other columns are kept.
        Those in m/s^2 are divided by the gravity that the calibration states (else by their own `# gravity_ms2`).
    out
        The file to write; RAW with _corrected added to its name where left out.
    gravity
        Gravity where the device is used, m/s^2 or a site (lat=48.14,height=520): columns in g are then written in g of
        there. Without it, one g stays that of the calibration.
    other_unit
        Correct the readings although their serial number is another than the calibration's.
    """
    from tumblecal.data.calibration import read_calibration
    from tumblecal.data.overwriting import inputs_kept
    from tumblecal.data.raw import read_raw, write_raw
    from tumblecal.ground.atomic import writable_folder
    from tumblecal.ground.errors import InputError
    from tumblecal.ground.gravity import STANDARD, gravity_of_option

    correction, given = read_calibration(calibration), read_raw(raw)
    local = None if gravity is None else gravity_of_option(gravity)
    if local is not None and correction.gravity is None:
        raise InputError(
            f"{calibration}: does not say which gravity its g is, so --gravity {gravity} cannot be told from it; calibrate "
            "again with --gravity"
        )
    _same_unit(correction, calibration, given, insisted=other_unit)
    table = given.in_g_of(correction.gravity)
    out = out or raw.with_name(f"{raw.stem}_corrected{raw.suffix}")
    inputs_kept([raw, calibration], out=out)
    writable_folder(out.parent)
    force = correction.corrected(table.readings, table.temperature_degc())
    if local is not None and correction.gravity is not None and not table.in_ms2:
        force = force * correction.gravity.in_g_of(local)
    write_raw(out, table, force, str(calibration), None if table.in_ms2 else local)
    for words in _warnings(given):
        print(f"WARNING: {raw}: {words}", file=sys.stderr)
    if table.in_ms2:
        print(f"one g is {table.gravity or STANDARD}{', as in the calibration' if correction.gravity else ''}")
    elif local is not None:
        print(f"one g of the corrected columns is {local}; the calibration's is {correction.gravity}")
    print(f"{out}: {len(table.readings)} rows corrected")


def _same_unit(correction: "Calibration", calibration: Path, raw: "Raw", *, insisted: bool) -> None:
    """Refuse readings of another unit.

    **Raises:** `InputError` where the serial numbers differ and nobody insisted.
    """
    from tumblecal.data.positions import serial_number_of
    from tumblecal.ground.errors import InputError

    own, theirs = correction.serial_number, serial_number_of(raw.comments)
    if own and theirs and theirs != own and not insisted:
        raise InputError(
            f"{raw.path}: serial number {theirs}, but {calibration} is of {own}; give that unit's calibration, or --other-unit "
            "to insist"
        )


def _warnings(raw: "Raw") -> list[str]:
    """What is unlikely of readings that a calibration at rest is for."""
    import numpy as np

    from tumblecal.ground.axes import AXES

    if not raw.readings.size:
        return []
    words = []
    sizes = np.linalg.norm(raw.readings, axis=1)
    middle = float(np.median(sizes))
    if not raw.in_ms2 and _LIKE_MS2[0] < middle < _LIKE_MS2[1]:
        listed = ", ".join(raw.columns)
        renamed = ", ".join(f"a{axis}_ms2" for axis in AXES)
        words.append(
            f"columns {listed}: their norm is about {middle:.3g} g, so they look like m/s^2; name them {renamed}"
        )
    far = np.any(np.abs(raw.readings) > _FAR_G, axis=1)
    if np.any(far) and not words:
        row = raw.first_line + int(np.argmax(far))
        words.append(
            f"{int(far.sum())} of {len(far)} rows (the first: line {row}) are beyond {_FAR_G:g} g, up to "
            f"{np.max(np.abs(raw.readings)):.3g} g; the calibration was measured within 1 g and says nothing of what is not "
            "linear out there"
        )
    return words
