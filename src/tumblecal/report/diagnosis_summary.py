"""`summary.csv`: one line for every file of a batch that was diagnosed."""

from pathlib import Path

from tumblecal.diagnosis import Diagnosis
from tumblecal.ground.atomic import written_aside
from tumblecal.ground.errors import InputError


COLUMNS = ("file", "serial_number", "verdict", "causes", "probability", "p_value", "cv_gain_g", "sigma_g", "fault")
_NUMBERS = ("probability", "p_value", "cv_gain_g", "sigma_g")


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
    import polars as pl  # a sixth of a second, which one file does without

    schema = {name: pl.Float64 if name in _NUMBERS else pl.String for name in COLUMNS}
    with written_aside(path) as aside:
        pl.DataFrame(rows, schema=schema).write_csv(aside)
