"""`summary.csv`: one line for every file of a batch that was calibrated or diagnosed."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.ground.atomic import written_aside
from tumblecal.ground.errors import InputError
from tumblecal.ground.plain_text import all_as_text


if TYPE_CHECKING:
    from tumblecal.diagnosis import Diagnosis
    from tumblecal.estimation.methods import Calibrated

# Columns of a batch; these are words.
_WORDS = ("file", "serial_number", "judgement", "use", "verdict", "causes", "fault")
CALIBRATED = (
    *("file", "serial_number", "judgement", "fault", "use", "rms_g", "chi2_per_dof"),
    *(column for name in SENSOR for column in (name, f"{name}_sd")),
)
DIAGNOSED = ("file", "serial_number", "verdict", "causes", "probability", "p_value", "cv_gain_g", "sigma_g", "fault")


def calibration_row(file: Path, calibrated: "Calibrated | InputError") -> dict[str, Any]:
    """The line of one file: serial number, judgement and use, residual rms (g), chi2/dof if the noise is stated, and the
    parameters with their standard uncertainties (1, g, rad); for a failed file only the fault."""
    if isinstance(calibrated, InputError):
        return {"file": str(file), "judgement": "refused", "fault": "; ".join(calibrated.faults)}
    exact = calibrated.exact
    return {
        "file": str(file),
        "serial_number": exact.data.serial_number,
        "judgement": " ".join(judgement.headline for judgement in calibrated.judgements),
        "use": calibrated.use.answer,
        "rms_g": exact.rms,
        "chi2_per_dof": exact.chi2 / exact.dof if exact.noise == "stated" and exact.dof > 0 else None,
        **dict(zip(exact.names, exact.values, strict=True)),
        **{f"{name}_sd": sd for name, sd in zip(exact.names, exact.sd, strict=True)},
    }


def diagnosis_row(file: Path, diagnosis: "Diagnosis | InputError") -> dict[str, Any]:
    """The line of one file: serial number, verdict, causes, their probability, the test's p-value, the gain in cross-validated
    prediction error (g) and the residual sd (g); for a failed file only the fault."""
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


def write_summary(path: Path, rows: Sequence[Mapping], columns: Sequence[str]) -> None:
    """Write these columns of the lines, all lines or none."""
    import polars as pl  # a sixth of a second, which one file does without

    schema = {name: pl.String if name in _WORDS else pl.Float64 for name in columns}
    with written_aside(path) as aside:
        pl.DataFrame(rows, schema=schema).with_columns(all_as_text()).write_csv(aside)
