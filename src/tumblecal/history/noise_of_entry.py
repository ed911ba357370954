"""What an entry's files say of its noise: degrees of freedom, and the noise's part of its covariance."""

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any


if TYPE_CHECKING:
    from tumblecal.data.sensor_parameters import SensorParameters


def of_noise(parameters: "SensorParameters", documents: Mapping[str, str], *, combined: bool) -> "SensorParameters":
    """An entry's parameters with the degrees of freedom of its noise, by `calibration.json`, else (of earlier versions) by
    `result.json`; where neither says, the covariance counts as known.

    **Arguments:**

    - `combined`: whether the covariance holds a budget's inputs; the noise's own is then that of `calibration.json`.
    """
    import numpy as np

    from tumblecal.data.noise_dof import of_result

    own, result = (_content(documents, name) for name in ("calibration.json", "result.json"))
    said = own.get("provenance")
    dof = said["dof"] if isinstance(said, dict) and "dof" in said else of_result(result)
    if not isinstance(dof, int | float) or not math.isfinite(dof):
        return parameters
    noise = own.get("parameters") if combined else None
    if not isinstance(noise, dict) or noise.get("names") != list(parameters.names):
        return replace(parameters, dof=float(dof))
    return replace(parameters, dof=float(dof), noise=np.array(noise["covariance"]))


def has_parts(documents: Mapping[str, str]) -> bool:
    """Whether `calibration.json` of an entry is one of a diagnosis that lists other explanations and undetected effects."""
    from tumblecal.data.uncertainty_parts import PARTS

    said = _content(documents, "calibration.json").get("provenance")
    return isinstance(said, dict) and PARTS in said


def _content(documents: Mapping[str, str], name: str) -> dict[str, Any]:
    try:
        content = json.loads(documents.get(name, "{}"))
    except (ValueError, RecursionError):  # what somebody added says nothing of the noise
        return {}
    return content if isinstance(content, dict) else {}
