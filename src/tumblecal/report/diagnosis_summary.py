"""`summary.csv`: one line for every file of a batch that was diagnosed."""

from pathlib import Path

import polars as pl

from tumblecal.diagnosis import Diagnosis
from tumblecal.ground.atomic import written_aside
from tumblecal.ground.errors import InputError


COLUMNS = {
    "file": pl.String,
    "serial_number": pl.String,
    "verdict": pl.String,
    "causes": pl.String,
    "probability": pl.Float64,
    "p_value": pl.Float64,
    "cv_gain_g": pl.Float64,
    "sigma_g": pl.Float64,
    "fault": pl.String,
}


def summary_row(file: Path, diagnosis: Diagnosis | InputError) -> dict:
    """One file's line: serial number, verdict, causes, their probability, the test's p-value, the gain in cross-validated
    prediction error (g) and the residual sd (g); for a file that could not be diagnosed only the fault."""
    if isinstance(diagnosis, InputError):
        return {"file": str(file), "verdict": "refused", "fault": "; ".join(diagnosis.faults)}
    return {
        "file": str(file),
        "serial_number": diagnosis.data.serial_number,
        "verdict": diagnosis.verdict,
        "causes": " + ".join(diagnosis.labels),
        "probability": diagnosis.best.probability,
        "p_value": diagnosis.screened.detection.p_value,
        "cv_gain_g": diagnosis.gain.cv_rms_before_g - diagnosis.gain.cv_rms_after_g,
        "sigma_g": diagnosis.sigma_g,
    }


def write_summary(path: Path, rows: list[dict]) -> None:
    """Write the lines, whole or not at all."""
    with written_aside(path) as aside:
        pl.DataFrame(rows, schema=COLUMNS).write_csv(aside)
