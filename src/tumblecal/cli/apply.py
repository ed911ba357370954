"""`tumblecal apply`: corrected data."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from tumblecal.capture.recordings.guesses import guessed
from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.cli.output import Quiet, warn
from tumblecal.ground.counted import counted


def apply(
    calibration: Path,
    raw: Path,
    /,
    *,
    out: Path | None = None,
    options: Annotated[RecordingOptions, Parameter(name="*")] = RecordingOptions(),
    other_unit: Annotated[bool, Parameter(negative=())] = False,
    use_anyway: Annotated[bool, Parameter(negative=())] = False,
    quiet: Quiet = False,
) -> None:
    """Correct raw readings by a calibration file: f = matrix (A - bias), and its nonlinear, thermal and drift terms if any.

    Files of any size are worked through a piece at a time. Rows beyond what was calibrated, saturated, or that look like
    another unit are counted and said. Where a device is used under another gravity, --gravity says which: columns in g are
    then written in g of there; without it, one g stays that of the calibration.

    Parameters
    ----------
    calibration
        The calibration.json that calibrate or diagnose wrote.
    raw
        The readings: a table with columns ax_g, ay_g, az_g (or _mg, _ms2, or those that --columns names). All else in it is
        kept; text stays as it was, byte for byte. Of other recordings, as tumblecal import reads them, the samples are
        written, corrected. Rows without a reading (erased memory, torn lines) are left out and listed in the corrected file;
        other damage is reported. Readings in m/s^2 are divided by the gravity that the calibration states (else by their own
        `# gravity_ms2`).
    out
        The file to write, .csv or .parquet; by default RAW with _corrected added to its name.
    other_unit
        Correct the readings although their serial number is another than the calibration's.
    use_anyway
        Apply a calibration whose own judgement is that it must not be used (`use: no`).
    """
    from tumblecal.capture.correction import Correction, write_corrected
    from tumblecal.capture.uncorrected import uncorrected
    from tumblecal.data.calibration import read_calibration
    from tumblecal.data.calibration_terms import undetermined_words
    from tumblecal.data.not_applied import losses_words
    from tumblecal.data.overwriting import inputs_kept
    from tumblecal.data.sensor_parameters import SENSOR
    from tumblecal.ground.atomic import writable_file
    from tumblecal.ground.errors import InputError
    from tumblecal.ground.gravity import gravity_of_option
    from tumblecal.report.recording_words import recording_words

    local = gravity_of_option(options.gravity) if options.gravity else None
    read = read_calibration(calibration)
    read.use.require(calibration, anyway=use_anyway)
    correction = Correction(read, calibration, local, other_unit)
    its_gravity = correction.calibration.gravity
    if local is not None and its_gravity is None:
        raise InputError(
            f"{calibration}: does not say which gravity its g is, so --gravity {options.gravity} cannot be told from it; "
            "calibrate again with --gravity"
        )
    source = uncorrected(raw, replace(options, gravity=""), correction.calibration)
    out = out or source.out_beside(raw)
    inputs_kept([raw, calibration], out=out)
    if out.suffix not in (".csv", ".parquet", source.out_beside(raw).suffix) and not out.is_dir():
        raise InputError(f"{out}: must end in .csv or .parquet")
    writable_file(out)
    with guessed(source.contents.layout.said if source.contents else ()):
        checks, one_g = write_corrected(out, source, correction)
    for words in checks.words():
        print(f"WARNING: {raw}: {words}", file=sys.stderr)
    if left := correction.calibration.sensor.of(SENSOR).undetermined_words:
        print(f"WARNING: {calibration}: the data did not determine {left}", file=sys.stderr)
    warn(raw, source.damage.lines)
    print(f"use of {calibration}: {read.use.words}")
    for line in recording_words(source.contents, kept=source.schema is not None) if source.contents else ():
        print(line)
    if one_g is not None:
        print(f"one g is {one_g}{', as in the calibration' if its_gravity else ''}")
    elif local is not None:
        print(f"one g of the corrected columns is {local}; the calibration's is {its_gravity}")
    if words := undetermined_words(correction.calibration.terms):
        print(words)
    for words in losses_words(correction.calibration.not_applied):
        print(words)
    if source.left_out:
        print(f"left out: {source.left_out}")
    print(f"{out}: {counted(checks.rows, 'row')} corrected")
