"""`tumblecal apply`: corrected data."""

from pathlib import Path


def apply(calibration: Path, raw: Path, /, *, out: Path | None = None) -> None:
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
    """
    from tumblecal.data.calibration import read_calibration
    from tumblecal.data.calibration_extended import corrected
    from tumblecal.data.overwriting import inputs_kept
    from tumblecal.data.raw import read_raw, write_raw
    from tumblecal.ground.atomic import writable_folder
    from tumblecal.ground.gravity import STANDARD

    correction = read_calibration(calibration)
    table = read_raw(raw).in_g_of(correction.gravity)
    out = out or raw.with_name(f"{raw.stem}_corrected{raw.suffix}")
    inputs_kept([raw, calibration], out=out)
    writable_folder(out.parent)
    write_raw(out, table, corrected(correction, table.readings, table.temperature_degc()), str(calibration))
    if table.in_ms2:
        print(f"one g is {table.gravity or STANDARD}{', as in the calibration' if correction.gravity else ''}")
    print(f"{out}: {len(table.readings)} rows corrected")
