"""Noise of an entry, from its files: degrees of freedom, and the part of the noise in its covariance."""

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any


if TYPE_CHECKING:
    from tumblecal.data.sensor_parameters import SensorParameters


def of_noise(parameters: "SensorParameters", documents: Mapping[str, str], *, combined: bool) -> "SensorParameters":
    """The parameters of an entry with the degrees of freedom of its noise, from `calibration.json`; if it does not state
    them, the covariance is treated as known.

    **Arguments:**

    - `combined`: whether the covariance includes inputs of a budget; that of the noise is then in `calibration.json`.
    """
    import numpy as np

    calibration = _content(documents, "calibration.json")
    provenance = calibration.get("provenance")
    dof = provenance.get("dof") if isinstance(provenance, dict) else None
    if not isinstance(dof, int | float) or not math.isfinite(dof):
        return parameters
    noise = calibration.get("parameters") if combined else None
    if not isinstance(noise, dict) or noise.get("names") != list(parameters.names):
        return replace(parameters, dof=float(dof))
    return replace(parameters, dof=float(dof), noise=np.array(noise["covariance"]))


def has_parts(documents: Mapping[str, str]) -> bool:
    """Whether the `calibration.json` of an entry is from a diagnosis with other explanations and undetected effects."""
    from tumblecal.data.uncertainty_parts import PARTS

    provenance = _content(documents, "calibration.json").get("provenance")
    return isinstance(provenance, dict) and PARTS in provenance


def _content(documents: Mapping[str, str], name: str) -> dict[str, Any]:
    try:
        content = json.loads(documents.get(name, "{}"))
    except (ValueError, RecursionError):  # files from other sources have no information on the noise
        return {}
    return content if isinstance(content, dict) else {}
