"""`summary.csv`: one line for every file of several that were calibrated."""

from pathlib import Path

import polars as pl

from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.estimation.methods import Calibrated
from tumblecal.ground.atomic import written_aside
from tumblecal.ground.errors import InputError
from tumblecal.report.calibration_judgements import judgements, use_of


def summary_row(file: Path, calibrated: Calibrated | InputError) -> dict:
    """One file's line: serial number, what is thought of the fit, residual rms (g), chi2/dof where the noise is stated, and
    the sensor's parameters with their sd (1, g, rad); for a file that could not be calibrated only the fault."""
    if isinstance(calibrated, InputError):
        return {"file": str(file), "judgement": "refused", "fault": "; ".join(calibrated.faults)}
    exact, judged = calibrated.exact, judgements(calibrated)
    row = {
        "file": str(file),
        "serial_number": exact.data.serial_number,
        "judgement": " ".join(own.headline for own in judged),
        "use": use_of(calibrated, judged).answer,
        "rms_g": exact.rms,
        "chi2_per_dof": exact.chi2 / exact.dof if exact.noise == "stated" and exact.dof > 0 else None,
    }
    for name, value, sd in zip(exact.names, exact.values.tolist(), exact.sd.tolist(), strict=True):
        if name in SENSOR:
            row |= {name: value, f"{name}_sd": sd}
    return row


def write_summary(path: Path, rows: list[dict]) -> None:
    """Write the lines, whole or not at all."""
    numbers = ("rms_g", "chi2_per_dof", *(column for name in SENSOR for column in (name, f"{name}_sd")))
    words = dict.fromkeys(("file", "serial_number", "judgement", "fault", "use"), pl.String)
    schema = {**words, **dict.fromkeys(numbers, pl.Float64)}
    with written_aside(path) as aside:
        pl.DataFrame([{name: row.get(name) for name in schema} for row in rows], schema=schema).write_csv(aside)
