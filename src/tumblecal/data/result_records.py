"""`result.json` of calibrate, `diagnosis.json` of diagnose and `check.json` of check: the keys that the program reads again."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AliasPath, Field

from tumblecal.data.calibration import Calibration
from tumblecal.ground.json_file import read_json
from tumblecal.ground.strict_json import Finite, Flag, Record, Text


RESULT, DIAGNOSIS, CHECK = "result.json", "diagnosis.json", "check.json"
REMEDY = "run the command that wrote this file again"


def _at(*keys: str | int) -> Any:
    """A field at a path of the file: keys, and numbers in lists."""
    first, *rest = keys
    return Field(validation_alias=AliasPath(str(first), *rest))


class StatedJudgement(Record):
    """A judgement of the calibration; `refused`: it must not be used."""

    tone: Text = ""
    headline: Text = ""
    advice: Text = ""
    refused: Flag = False


class StatedImplausible(Record):
    """A parameter with a value far outside the usual range."""

    parameter: Text


class ResultFile(Record):
    """`result.json`."""

    schema_: Annotated[Literal["tumblecal.result/1"], Field(alias="schema")]
    source: Text = _at("source", "data")
    sha256: Text | None = _at("source", "sha256")
    code: Text = _at("methods", "exact", "code")
    rms_g: Finite | None = _at("noise", "rms_g")
    p_value: Finite | None = _at("noise", "chi2_p_value")
    judgement: StatedJudgement = StatedJudgement()
    implausible: list[StatedImplausible] = Field(default_factory=list)

    @property
    def outcome(self) -> str:
        """The outcome of the fit in words."""
        return self.code.lower().replace("_", " ")


class DiagnosisFile(Record):
    """`diagnosis.json`, with the names of `ResultFile`."""

    schema_: Annotated[Literal["tumblecal.diagnosis/1"], Field(alias="schema")]
    source: Text
    sha256: None = None
    verdict: Text
    causes: list[Text]
    rms_g: Finite | None = _at("sigma_g")
    p_value: Finite | None = _at("detection", "p_value")
    judgement: StatedJudgement = StatedJudgement()
    implausible: list[StatedImplausible] = Field(default_factory=list)

    @property
    def outcome(self) -> str:
        """Verdict and causes."""
        return self.verdict + (f": {', '.join(self.causes)}" if self.causes else "")


class CheckFile(Record):
    """`check.json`, with the names of `ResultFile`; `use`: that of the calibration after the check."""

    schema_: Annotated[Literal["tumblecal.check/1"], Field(alias="schema")]
    source: Text
    sha256: Text | None = _at("recording", 0, "sha256")
    verdict: Text
    answer: Text = _at("use", "answer")
    measured_utc: Text | None = None
    serial_number: Text | None = None
    rms_g: None = None
    p_value: Finite = _at("test", "p_value")
    changed: list[Text] = Field(default_factory=list, validation_alias=AliasPath("change", "named"))

    @property
    def outcome(self) -> str:
        """Verdict, and the parameters that changed."""
        return self.verdict + (f": {', '.join(self.changed)}" if self.changed else "")


def noise_dof(content: object) -> float | None:
    """Degrees of freedom of the noise in a `result.json`; infinite for stated noise, None if they are not in it."""
    match content:
        case {"noise": {"kind": "stated"}}:
            return math.inf
        case {"noise": {"kind": "estimated", "dof": int(dof)}}:
            return max(float(dof), 1.0)
    return None


def with_dof_of_result(file: Path, calibration: Calibration) -> Calibration:
    """The calibration; if it does not state its `dof` (as in earlier versions), with that of the `result.json` of the same
    data in its folder.

    **Raises:** `InputError` for a `result.json` that is not JSON.
    """
    path, provenance = file.parent / RESULT, calibration.provenance
    if calibration.dof is not None or "verdict" in provenance or "format" in provenance or not path.is_file():
        return calibration
    content = read_json(path)
    match content:
        case {"source": {"sha256": str(digest)}} if digest != provenance.get("sha256"):
            return calibration
    dof = noise_dof(content)
    stated = {} if dof is None else {"dof": dof if math.isfinite(dof) else None}
    return replace(calibration, provenance=provenance | stated)
