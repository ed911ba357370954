"""`summary.csv`: one line for every file of a batch."""

from pathlib import Path

import polars as pl

from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.estimation.methods import Calibrated
from tumblecal.ground.atomic import written_aside
from tumblecal.ground.errors import InputError
from tumblecal.report.calibration_judgements import judgements, use_of


def summary_row(file: Path, calibrated: Calibrated | InputError) -> dict:
    """The line of one file: serial number, judgement and use, residual rms (g), chi2/dof if the noise is stated, and the
    parameters of the sensor with their standard uncertainties (1, g, rad); for a failed file only the fault."""
    if isinstance(calibrated, InputError):
        return {"file": str(file), "judgement": "refused", "fault": "; ".join(calibrated.faults)}
    exact, judged = calibrated.exact, judgements(calibrated)
    row = {
        "file": str(file),
        "serial_number": exact.data.serial_number,
        "judgement": " ".join(judgement.headline for judgement in judged),
        "use": use_of(calibrated, judged).answer,
        "rms_g": exact.rms,
        "chi2_per_dof": exact.chi2 / exact.dof if exact.noise == "stated" and exact.dof > 0 else None,
    }
    for name, value, sd in zip(exact.names, exact.values.tolist(), exact.sd.tolist(), strict=True):
        if name in SENSOR:
            row |= {name: value, f"{name}_sd": sd}
    return row


def write_summary(path: Path, rows: list[dict]) -> None:
    """Write the lines, all or none."""
    numbers = ("rms_g", "chi2_per_dof", *(column for name in SENSOR for column in (name, f"{name}_sd")))
    words = dict.fromkeys(("file", "serial_number", "judgement", "fault", "use"), pl.String)
    schema = {**words, **dict.fromkeys(numbers, pl.Float64)}
    with written_aside(path) as aside:
        pl.DataFrame([{name: row.get(name) for name in schema} for row in rows], schema=schema).write_csv(aside)
