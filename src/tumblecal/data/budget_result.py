"""`budget.json` read back: what a budget adds to a calibration's own uncertainty."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import NormalDist

import numpy as np

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_parts import covariance, is_number, numbers
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters
from tumblecal.ground.errors import InputError
from tumblecal.ground.json_file import read_json_object
from tumblecal.ground.text_file import shown


NAME = "budget.json"
# A factor may have been rounded by so much.
_ROUNDED = 0.99


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

    def moved(self, calibration: Calibration) -> list[str]:
        """Parameters that are not the budget's to within their own sd, so that it is of another model; none for the extended
        model of a diagnosis, whose budget is that of the nominal one."""
        if "verdict" in calibration.provenance:
            return []
        own, here = calibration.sensor.of(SENSOR), self.type_b.of(SENSOR)
        apart = (np.abs(own.values - here.values) > own.sd) & (own.sd > 0)
        return [name for name, far in zip(SENSOR, apart, strict=True) if far]

    def combined(self, own: SensorParameters) -> SensorParameters:
        """A calibration's parameters with the combined covariance: their own, and what the inputs add."""
        shared = [name for name in own.names if name in self.type_b.names]
        covariance, here = own.covariance.copy(), np.ix_(own.places(shared), own.places(shared))
        covariance[here] += self.type_b.of(shared).covariance
        return replace(own, covariance=covariance)


def read_budget(path: Path) -> BudgetResult:
    """Read a `budget.json`.

    **Raises:** `InputError` for a file that is none, or is not of a whole sensor, and for a coverage factor that is none.
    """
    content = read_json_object(path)
    try:
        parameters, level = content["parameters"], content["level"]
        stated = {key: [own[key] for own in parameters.values()] for key in ("value", "k")}
        sha256 = content["source"]["sha256"]
        missing = [name for name in SENSOR if name not in parameters]
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"{path}: no budget of a whole sensor in it ({error}); make one with tumblecal budget"
        ) from error
    if missing:
        raise InputError(f"{path}: no budget of a whole sensor in it ({', '.join(missing)} missing); make one of it")
    _check_coverage(path, level, dict(zip(parameters, stated["k"], strict=True)))
    size = len(parameters)
    values = numbers(path, stated, "value", (size,), "parameters.")
    type_b = SensorParameters(tuple(parameters), values, covariance(path, content, size, key="type_b_covariance"))
    return BudgetResult(type_b, dict(zip(parameters, map(float, stated["k"]), strict=True)), float(level), sha256)


def _check_coverage(path: Path, level: object, factors: Mapping[str, object]) -> None:
    """Check the level and that each coverage factor is one of it.

    **Raises:** `InputError` for a level that is no probability, a factor that is no number, or smaller than that of a normal
    distribution, which has the smallest.
    """
    if not is_number(level) or not 0.5 <= level < 1:
        raise InputError(f"{path}: level: {shown(level)} is not a probability from 0.5 to below 1")
    least = NormalDist().inv_cdf(0.5 + level / 2)
    faults = [
        f"{path}: parameters.{name}.k: {shown(k)} is no coverage factor at a probability of {level:g}, which is {least:.3g} "
        "or more; make the budget again with tumblecal budget"
        for name, k in factors.items()
        if not (is_number(k) and k >= _ROUNDED * least)
    ]
    if faults:
        raise InputError(faults)


def with_budget_beside(file: Path, calibration: Calibration) -> SensorParameters | None:
    """A calibration's parameters with combined covariance, where a budget of the same data and model lies beside its file."""
    path = file.parent / NAME
    budget = read_budget(path) if path.is_file() else None
    if budget is None or not budget.is_of(calibration) or budget.moved(calibration):
        return None
    return budget.combined(calibration.sensor)
