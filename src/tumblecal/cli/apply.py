"""`tumblecal apply`: corrected data."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from tumblecal.cli.output import Quiet, warn
from tumblecal.ground.counted import counted
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.options import RecordingOptions


def apply(
    calibration: Path,
    raw: Path,
    /,
    *,
    out: Path | None = None,
    options: Annotated[RecordingOptions, Parameter(name="*")] = RecordingOptions(),
    other_unit: Annotated[bool, Parameter(negative=())] = False,
    extrapolate: Annotated[bool, Parameter(negative=())] = False,
    use_anyway: Annotated[bool, Parameter(negative=())] = False,
    quiet: Quiet = False,
) -> None:
    """Correct raw readings by a calibration file: f = matrix (A - bias), with its nonlinear, thermal and drift terms if any.

    If its parameters follow temperature, matrix and bias are those at the temperature of each row (column temperature_degc).

    Files of any size are processed in pieces. The number of rows beyond the calibrated range, saturated rows and rows that
    look like a different unit is reported. If a device is used under a different gravity, give that value to --gravity:
    columns in g are then expressed in g of that site. By default one g is that of the calibration.

    Parameters
    ----------
    calibration
        The calibration.json of calibrate or diagnose.
    raw
        Readings: a table with columns ax_g, ay_g, az_g (or _mg, _ms2, or those of --columns). All other columns are copied.
        For other recordings that tumblecal import reads, the corrected samples are written.
        Rows without a reading (erased memory, incomplete lines) are omitted and listed in the corrected file; other damage
        is reported. Readings in m/s^2 are divided by the gravity of the calibration; if it states none, by their
        `# gravity_ms2`.
    out
        Corrected file (.csv or .parquet). Default: RAW_corrected.csv for tables, RAW_corrected.parquet for Parquet and other
        recordings. Example: --out corrected.csv.
    other_unit
        Correction of readings whose serial number differs from that of the calibration. Default: an error.
    extrapolate
        Correction of rows at temperatures outside the measured range of a calibration whose parameters follow temperature;
        their uncertainty is larger and is reported. Default: an error.
    use_anyway
        Use of a calibration with the judgement `use: no`. Default: an error.
    """
    from tumblecal.data.calibration_terms import undetermined_words
    from tumblecal.data.not_applied import losses_words
    from tumblecal.data.overwriting import protect_inputs
    from tumblecal.data.result_records import read_checked
    from tumblecal.data.sensor_parameters import SENSOR
    from tumblecal.ground.atomic import writable_file
    from tumblecal.ground.errors import InputError
    from tumblecal.ground.gravity import gravity_of_option
    from tumblecal.recordings.correction.correction import Correction, write_corrected
    from tumblecal.recordings.correction.uncorrected import uncorrected
    from tumblecal.show.recordings import layout_lines

    local = gravity_of_option(options.gravity) if options.gravity else None
    read = read_checked(calibration)
    read.use.require(calibration, anyway=use_anyway)
    correction = Correction(read, calibration, local, other_unit, extrapolate)
    calibrated_gravity = correction.calibration.gravity
    if local is not None and calibrated_gravity is None:
        raise InputError(
            f"{calibration}: no gravity is stated, so readings cannot be converted to --gravity {options.gravity}; calibrate "
            "again with --gravity"
        )
    source = uncorrected(raw, replace(options, gravity=""), correction.calibration)
    out = out or source.out_beside(raw)
    protect_inputs([raw, calibration], out=out)
    if out.suffix not in (".csv", ".parquet") and not out.is_dir():
        raise InputError(f"{out}: must end in .csv or .parquet")
    writable_file(out)
    with guessed(source.recording.layout.notes if source.recording else ()):
        checks, outside, one_g = write_corrected(out, source, correction)
    for words in [*checks.words(), *(outside.words() if outside else ())]:
        print(f"WARNING: {raw}: {words}", file=sys.stderr)
    if undetermined := correction.calibration.sensor.of(SENSOR).undetermined_words:
        print(f"WARNING: {calibration}: the data did not determine {undetermined}", file=sys.stderr)
    warn(raw, source.recording.damage.lines if source.recording else [])
    print(f"use of {calibration}: {read.use.words}")
    for line in layout_lines([source.recording] if source.recording else []):
        print(line)
    if one_g is not None:
        print(f"one g is {one_g}{', as in the calibration' if calibrated_gravity else ''}")
    elif local is not None:
        print(f"one g of the corrected columns is {local}; the calibration's is {calibrated_gravity}")
    if words := undetermined_words(correction.calibration.terms):
        print(words)
    for words in losses_words(correction.calibration.not_applied):
        print(words)
    if source.left_out:
        print(f"left out: {source.left_out}")
    print(f"{out}: {counted(checks.rows, 'row')} corrected")
