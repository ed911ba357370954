"""Contributions to the covariance of a diagnosis, from the provenance of its `calibration.json`."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import Calibration
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters
from tumblecal.ground.errors import InputError


# Keys of `provenance`: standard uncertainties by contribution, and the ids of the effects that the last one is about.
PARTS, UNDETECTED = "uncertainty_parts", "undetected_effects"
NOISE = "noise"
# Contributions in addition to the noise, and their names in tables.
LABELS = {"explanations": "other explanations", "undetected_effects": "undetected effects"}
# Relative tolerance of the root sum of squares, compared with the standard uncertainties of the file.
_SAME = 1e-6


@dataclass(frozen=True)
class UncertaintyParts:
    """The sensor's and mount's parameters of a diagnosis with the one covariance in use, and its contributions.

    - `parameters`: values and covariance, base units; `dof` that of the noise.
    - `noise`, `diagnosis_parts`: standard uncertainties by the noise, and by each of `LABELS`, which add in quadrature.
    - `undetected`: ids of the effects in "undetected effects"; None in files that do not state them.
    - `causes`: ids of the effects in the explanations.
    """

    parameters: SensorParameters
    noise: Float[np.ndarray, " names"]
    diagnosis_parts: dict[str, Float[np.ndarray, " names"]]
    undetected: frozenset[str] | None
    causes: frozenset[str]


def uncertainty_parts(path: Path, calibration: Calibration) -> UncertaintyParts:
    """The parts of a calibration's covariance.

    **Raises:** `InputError` for a file without contributions, or with contributions that contradict its covariance.
    """
    listed = calibration.provenance.get(PARTS) or {}
    if not all(part in listed for part in (NOISE, *LABELS)):
        raise InputError(f"{path}: no contributions to the uncertainty; give the folder of tumblecal diagnose")
    names = [name for name in calibration.sensor.names if all(name in listed[part] for part in (NOISE, *LABELS))]
    if missing := [name for name in SENSOR if name not in names]:
        raise InputError(f"{path}: provenance.{PARTS}: {', '.join(missing)} missing; diagnose the data again")
    sensor = calibration.sensor.of(names)
    sizes = {part: np.array([listed[part][name] for name in names], float) for part in (NOISE, *LABELS)}
    whole = np.linalg.norm(np.stack(list(sizes.values())), axis=0)
    if not np.allclose(whole, sensor.sd, rtol=_SAME, atol=0):
        raise InputError(
            f"{path}: provenance.{PARTS} contradicts the covariance of parameters; diagnose the data again"
        )
    diagnosis_parts = {label: sizes[part] for part, label in LABELS.items()}
    ids = calibration.provenance.get(UNDETECTED)
    undetected = None if ids is None else frozenset(ids)
    # The effects of all explanations in the model average.
    models = [calibration.provenance, *calibration.provenance.get("averaged_over", [])]
    causes = frozenset(id for model in models for id in model.get("causes", []))
    return UncertaintyParts(sensor, sizes[NOISE], diagnosis_parts, undetected, causes)


def contribution_words(calibration: Calibration, more: str = "") -> str:
    """The contributions to the uncertainty of a calibration, and one more, as a list in words."""
    listed = ["the noise", *(LABELS.values() if PARTS in calibration.provenance else ()), *filter(None, [more])]
    return f"{', '.join(listed[:-1])} and {listed[-1]}" if listed[1:] else "only the noise (type A)"
