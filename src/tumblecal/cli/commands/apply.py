"""`tumblecal apply`: corrected data."""

from dataclasses import replace
from pathlib import Path

from tumblecal.cli.options import Quiet
from tumblecal.cli.recording_options import Recording
from tumblecal.cli.result_files import table_file
from tumblecal.cli.terminal import warn
from tumblecal.ground.numbers_shown import counted
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.options import RecordingOptions


def apply(
    calibration: Path,
    raw: Path,
    /,
    *,
    out: Path | None = None,
    options: Recording = RecordingOptions(),
    other_unit: bool = False,
    extrapolate: bool = False,
    use_anyway: bool = False,
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
    from tumblecal.data.result_records import read_checked
    from tumblecal.data.sensor_parameters import SENSOR
    from tumblecal.ground.errors import InputError
    from tumblecal.ground.gravity import gravity_of_option
    from tumblecal.recordings.correction.correction import write_corrected
    from tumblecal.recordings.correction.uncorrected import uncorrected
    from tumblecal.show.recordings import layout_lines

    local = gravity_of_option(options.gravity) if options.gravity else None
    read = read_checked(calibration)
    read.use.require(calibration, anyway=use_anyway)
    if local is not None and read.gravity is None:
        raise InputError(
            f"{calibration}: no gravity is stated, so readings cannot be converted to --gravity {options.gravity}; calibrate "
            "again with --gravity"
        )
    source = uncorrected(raw, replace(options, gravity=""), read)
    out = table_file(out or source.out_beside(raw), [raw, calibration])
    with guessed(source.recording.layout.notes if source.recording else ()):
        checks, outside, one_g = write_corrected(
            out, source, read, calibration, local, other_unit=other_unit, extrapolate=extrapolate
        )
    warn(raw, [*checks.words(), *(outside.words() if outside else ())])
    if undetermined := read.sensor.of(SENSOR).undetermined_words:
        warn(calibration, [f"the data did not determine {undetermined}"])
    words = [f"use of {calibration}: {read.use.words}"]
    if source.recording:
        warn(raw, source.recording.damage.lines)
        words += layout_lines([source.recording])
    if one_g is not None:
        words.append(f"one g is {one_g}{', as in the calibration' if read.gravity else ''}")
    elif local is not None:
        words.append(f"one g of the corrected columns is {local}; the calibration's is {read.gravity}")
    words += [undetermined_words(read.terms), *losses_words(read.not_applied)]
    words.append(source.left_out and f"left out: {source.left_out}")
    print("\n".join(filter(None, [*words, f"{out}: {counted(checks.rows, 'row')} corrected"])))
