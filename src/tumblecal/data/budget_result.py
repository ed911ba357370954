"""`budget.json` read back: what a budget adds to a calibration's own uncertainty."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tumblecal.data.calibration import Calibration
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import read_text


NAME = "budget.json"


@dataclass(frozen=True)
class BudgetResult:
    """A budget's inputs as they act on the parameters (`type_b`, base units, a covariance without the data's noise), the
    coverage factor of each parameter at `level`, and the SHA-256 of the data."""

    type_b: SensorParameters
    coverage: Mapping[str, float]
    level: float
    sha256: str | None

    def is_of(self, calibration: Calibration) -> bool:
        """Whether both were made from the same data, as far as is known."""
        return not self.sha256 or calibration.provenance.get("sha256") in (None, self.sha256)

    def combined(self, own: SensorParameters) -> SensorParameters:
        """A calibration's parameters with the combined covariance: their own, and what the inputs add."""
        shared = [name for name in own.names if name in self.type_b.names]
        covariance, here = own.covariance.copy(), np.ix_(own.places(shared), own.places(shared))
        covariance[here] += self.type_b.of(shared).covariance
        return replace(own, covariance=covariance)


def read_budget(path: Path) -> BudgetResult:
    """Read a `budget.json`.

    **Raises:** `InputError` for a file that is none, or is not of a whole sensor.
    """
    try:
        content = json.loads(read_text(path, "JSON"))
        parameters = content["parameters"]
        values = np.array([own["value"] for own in parameters.values()], float)
        type_b = SensorParameters(tuple(parameters), values, np.array(content["type_b_covariance"], float))
        type_b.of(SENSOR)
        coverage = {name: float(own["k"]) for name, own in parameters.items()}
        return BudgetResult(type_b, coverage, float(content["level"]), content["source"]["sha256"])
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, RecursionError) as error:
        raise InputError(
            f"{path}: no budget of a whole sensor in it ({error}); make one with tumblecal budget"
        ) from error


def with_budget_beside(file: Path, calibration: Calibration) -> SensorParameters | None:
    """A calibration's parameters with combined covariance, where a budget of the same data lies beside its file."""
    path = file.parent / NAME
    budget = read_budget(path) if path.is_file() else None
    return budget.combined(calibration.sensor) if budget is not None and budget.is_of(calibration) else None
