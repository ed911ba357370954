"""Degrees of freedom of the noise from `result.json`, for a `calibration.json` of an earlier version without them."""

import math
from dataclasses import replace
from pathlib import Path

from tumblecal.data.calibration import Calibration
from tumblecal.ground.json_file import read_json_object


RESULT = "result.json"


def of_result(content: object) -> float | None:
    """Degrees of freedom in a `result.json`; infinite for stated noise, None if they are not in it."""
    noise = content.get("noise") if isinstance(content, dict) else None
    kind, dof = (noise.get("kind"), noise.get("dof")) if isinstance(noise, dict) else (None, None)
    if kind == "stated":
        return math.inf
    return max(float(dof), 1.0) if kind == "estimated" and isinstance(dof, int) else None


def with_dof_of_result(file: Path, calibration: Calibration) -> Calibration:
    """The calibration; if it does not state its `dof`, with that of the `result.json` of the same data in its folder.

    **Raises:** `InputError` for a `result.json` that is not JSON.
    """
    path, provenance = file.parent / RESULT, calibration.provenance
    if calibration.dof is not None or "verdict" in provenance or "format" in provenance or not path.is_file():
        return calibration
    content = read_json_object(path)
    source = content.get("source")
    digest = source.get("sha256") if isinstance(source, dict) else None
    if digest not in (None, provenance.get("sha256")):
        return calibration
    dof = of_result(content)
    return (
        calibration
        if dof is None
        else replace(calibration, provenance=provenance | {"dof": dof if math.isfinite(dof) else None})
    )
