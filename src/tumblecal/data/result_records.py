"""`result.json` of calibrate, `diagnosis.json` of diagnose and `check.json` of check: the keys that the program reads again."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from tumblecal.data.calibration import Calibration, read_calibration
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.json_file import read_json
from tumblecal.ground.record import at
from tumblecal.ground.strict_json import Finite, Flag, Record, Size, Text, read_record, validated


RESULT, DIAGNOSIS, CHECK = "result.json", "diagnosis.json", "check.json"
REMEDY = "run the command that wrote this file again"


class StatedJudgement(Record):
    """A judgement of the calibration; `refused`: it must not be used."""

    tone: Text = ""
    headline: Text = ""
    advice: Text = ""
    refused: Flag = False


class ResultFile(Record):
    """`result.json`."""

    schema_: Annotated[Literal["tumblecal.result/1"], Field(alias="schema")]
    source: Text = at("source.data")
    sha256: Text | None = at("source.sha256")
    code: Text = at("methods.exact.code")
    rms_g: Finite | None = at("noise.rms_g")
    p_value: Finite | None = at("noise.chi2_p_value")
    judgement: StatedJudgement = StatedJudgement()

    @property
    def outcome(self) -> str:
        """The outcome of the fit in words."""
        return self.code.lower().replace("_", " ")


class DiagnosisFile(Record):
    """`diagnosis.json`, with the names of `ResultFile`."""

    schema_: Annotated[Literal["tumblecal.diagnosis/1"], Field(alias="schema")]
    source: Text
    sha256: Text | None = None
    answer: Text = at("use.answer", "no")
    verdict: Text
    causes: list[Text]
    rms_g: Finite | None = at("sigma_g")
    p_value: Finite | None = at("detection.p_value")
    judgement: StatedJudgement = StatedJudgement()

    @property
    def outcome(self) -> str:
        """Verdict and causes."""
        return self.verdict + (f": {', '.join(self.causes)}" if self.causes else "")


class CheckFile(Record):
    """`check.json`, with the names of `ResultFile`; `use`: that of the calibration after the check."""

    schema_: Annotated[Literal["tumblecal.check/1"], Field(alias="schema")]
    source: Text
    sha256: Text | None = at("recording.0.sha256")
    verdict: Text
    answer: Text = at("use.answer")
    measured_utc: Text | None = None
    serial_number: Text | None = None
    rms_g: None = None
    p_value: Finite = at("test.p_value")
    changed: list[Text] = at("change.named", ())

    @property
    def outcome(self) -> str:
        """Verdict, and the parameters that changed."""
        return self.verdict + (f": {', '.join(self.changed)}" if self.changed else "")


class NoiseOfAxis(Record):
    """Noise coefficients of an axis in `reduction.json`."""

    white_g_per_rthz: Size
    walk_g_per_rts: Size


def noise_of_reduction(path: Path) -> tuple[dict[str, float], ...]:
    """The noise coefficients of the axes in a `reduction.json`.

    **Raises:** `InputError` for a file that is not a reduction.
    """
    axes: Any = read_json(path)
    try:
        stated = [axes["axes"][axis]["noise"] for axis in AXES]
    except (KeyError, TypeError) as error:
        raise InputError(f"{path}: no noise of three axes; give the reduction.json of tumblecal reduce") from error
    return tuple(vars(noise) for noise in validated(stated, list[NoiseOfAxis], str(path), "noise"))


def result_of(file: Path, calibration: Calibration) -> tuple[Path, ResultFile | DiagnosisFile] | None:
    """The result of calibrate or diagnose in the folder of a calibration, with its file; None if it was copied elsewhere.

    **Arguments:**

    - `file`: of the calibration.

    **Raises:** `InputError` for a result that cannot be read, or of other data.
    """
    provenance = calibration.provenance
    name, record = (DIAGNOSIS, DiagnosisFile) if "verdict" in provenance else (RESULT, ResultFile)
    path = file.parent / name
    if "format" in provenance or not path.is_file():
        return None
    result = read_record(path, record, REMEDY)
    for key, value in (("data", result.source), ("sha256", result.sha256)):
        if value is not None and provenance.get(key) not in (None, value):
            raise InputError(f"{path}: its data differ from those of {file.name} in this folder; {REMEDY}")
    return path, result


def read_checked(file: Path) -> Calibration:
    """The calibration of a file, if the result in its folder is of the same data.

    **Raises:** `InputError`, as `read_calibration` and `result_of`.
    """
    calibration = read_calibration(file)
    result_of(file, calibration)
    return calibration
