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
    out
        The file to write; RAW with _corrected added to its name where left out.
    """
    from tumblecal.data.atomic import writable_folder
    from tumblecal.data.calibration import read_calibration
    from tumblecal.data.calibration_extended import corrected
    from tumblecal.data.raw import read_raw, write_raw
    from tumblecal.errors import InputError

    correction = read_calibration(calibration)
    table = read_raw(raw)
    out = out or raw.with_name(f"{raw.stem}_corrected{raw.suffix}")
    if out.exists() and out.samefile(raw):
        raise InputError(f"{out}: would overwrite the raw data; give another file with --out")
    writable_folder(out.parent)
    temperature = table.frame["temperature_degc"].to_numpy() if "temperature_degc" in table.frame.columns else None
    write_raw(out, table, corrected(correction, table.readings, temperature), str(calibration))
    print(f"{out}: {len(table.readings)} rows corrected")
