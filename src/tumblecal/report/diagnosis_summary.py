"""`summary.csv`: one line for every file of a batch that was diagnosed."""

from pathlib import Path

import polars as pl

from tumblecal.data.atomic import written_aside
from tumblecal.diagnosis.diagnose import Diagnosis
from tumblecal.errors import InputError


COLUMNS = {
    "file": pl.String,
    "verdict": pl.String,
    "causes": pl.String,
    "probability": pl.Float64,
    "p_value": pl.Float64,
    "cv_gain_g": pl.Float64,
    "sigma_g": pl.Float64,
    "fault": pl.String,
}


def summary_row(file: Path, found: Diagnosis | InputError) -> dict:
    """One file's line: verdict, causes, their probability, the test's p-value, the gain in cross-validated prediction
    error (g) and the residual sd (g); for a file that could not be diagnosed only the fault."""
    if isinstance(found, InputError):
        return {"file": str(file), "verdict": "refused", "fault": "; ".join(found.faults)}
    return {
        "file": str(file),
        "verdict": found.verdict,
        "causes": " + ".join(found.labels),
        "probability": found.best.probability,
        "p_value": found.screened.detection.p_value,
        "cv_gain_g": found.gain.cv_rms_before_g - found.gain.cv_rms_after_g,
        "sigma_g": found.sigma_g,
    }


def write_summary(path: Path, rows: list[dict]) -> None:
    """Write the lines, whole or not at all."""
    with written_aside(path) as aside:
        pl.DataFrame(rows, schema=COLUMNS).write_csv(aside)
