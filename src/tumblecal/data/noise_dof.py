"""Degrees of freedom of the noise of files of earlier versions, whose `calibration.json` does not say: by `result.json`."""

import math
from dataclasses import replace
from pathlib import Path

from tumblecal.data.calibration import Calibration
from tumblecal.ground.json_file import read_json_object


RESULT = "result.json"


def of_result(content: object) -> float | None:
    """Degrees of freedom by what `result.json` holds, infinite where the noise was stated; None where it does not say."""
    noise = content.get("noise") if isinstance(content, dict) else None
    kind, dof = (noise.get("kind"), noise.get("dof")) if isinstance(noise, dict) else (None, None)
    if kind == "stated":
        return math.inf
    return max(float(dof), 1.0) if kind == "estimated" and isinstance(dof, int) else None


def with_dof_beside(file: Path, calibration: Calibration) -> Calibration:
    """The calibration; where it does not state its `dof`, with that of the result of the same data that lies beside it.

    **Raises:** `InputError` for a `result.json` that is no JSON.
    """
    path, said = file.parent / RESULT, calibration.provenance
    if calibration.dof is not None or "verdict" in said or "format" in said or not path.is_file():
        return calibration
    content = read_json_object(path)
    source = content.get("source")
    digest = source.get("sha256") if isinstance(source, dict) else None
    if digest not in (None, said.get("sha256")):
        return calibration
    dof = of_result(content)
    return (
        calibration
        if dof is None
        else replace(calibration, provenance=said | {"dof": dof if math.isfinite(dof) else None})
    )
