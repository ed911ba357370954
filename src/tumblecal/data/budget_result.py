"""`budget.json`: the contributions of a budget to the uncertainty of a calibration."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import NormalDist

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_parts import covariance, is_number, numbers
from tumblecal.data.coverage_factor import coverage_factors, effective_dof
from tumblecal.data.sensor_parameters import GROUPS, SENSOR, SensorParameters, leaf_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.json_file import read_json_object
from tumblecal.ground.text_file import shown
from tumblecal.ground.units import in_words
from tumblecal.ground.units import shown as shown_unit


NAME = "budget.json"
# Smallest ratio of a rounded coverage factor to the exact one.
_ROUNDED = 0.99
# Standard uncertainties with a smaller relative difference are due to the same noise.
_SAME_NOISE = 0.01
# Smallest degrees of freedom of an input, as in `chain.considered`.
_LEAST_DOF = 0.5


@dataclass(frozen=True)
class BudgetResult:
    """Contributions of the inputs of a budget to the parameters, base units.

    - `type_b`: values, and covariance without noise. `type_a`: standard uncertainties by the noise of the budget.
    - `contributions`, `dof`: standard uncertainties by each input, and its degrees of freedom.
    - `level`: coverage probability. `sha256`: of the data. `diagnosed`: whether it has the covariance of a diagnosis.
    """

    type_b: SensorParameters
    type_a: Float[np.ndarray, " parameters"]
    contributions: Float[np.ndarray, "inputs parameters"]
    dof: Float[np.ndarray, " inputs"]
    level: float
    sha256: str | None
    diagnosed: bool = False

    def is_of(self, calibration: Calibration) -> bool:
        """Whether both are from the same data; true if one of them does not state its data."""
        return not self.sha256 or calibration.provenance.get("sha256") in (None, self.sha256)

    def lacks(self, calibration: Calibration) -> bool:
        """Whether the budget includes contributions of a diagnosis, but the calibration is not from a diagnosis."""
        return self.diagnosed and "verdict" not in calibration.provenance

    def moved(self, calibration: Calibration) -> list[str]:
        """Parameters that differ from the budget by more than their standard uncertainty, so that its model is different.

        None for the extended model of a diagnosis, whose budget is for the nominal model."""
        if "verdict" in calibration.provenance:
            return []
        calibrated, budgeted = calibration.sensor.of(SENSOR), self.type_b.of(SENSOR)
        differ = (np.abs(calibrated.values - budgeted.values) > calibrated.sd) & (calibrated.sd > 0)
        return [name for name, differs in zip(SENSOR, differ, strict=True) if differs]

    def other_noise(self, calibration: Calibration) -> str:
        """Words on a budget whose noise differs from that of the calibration; "" if it is the same, and for the extended
        model of a diagnosis, which has more parameters."""
        if "verdict" in calibration.provenance:
            return ""
        budgeted, calibrated = self.type_a[self.type_b.places(SENSOR)], calibration.sensor.of(SENSOR).sd
        larger = np.maximum(calibrated, budgeted)
        excess = np.abs(calibrated - budgeted) - _SAME_NOISE * larger
        if not np.any(excess > 0):
            return ""
        worst = int(np.argmax(excess / np.maximum(larger, 1e-300)))
        unit, factor = shown_unit(GROUPS[leaf_of(SENSOR[worst])][1])
        sizes = [in_words(f"{size * factor:.3g}", unit) for size in (budgeted[worst], calibrated[worst])]
        worst_u = f"u_A of {SENSOR[worst]}: {sizes[0]}, here {sizes[1]}"
        return f"computed with a different noise from that of the calibration ({worst_u})"

    def coverage(self, calibrated: SensorParameters, dof: float) -> Float[np.ndarray, " parameters"]:
        """Coverage factors of the parameters of a calibration, with its noise and the inputs of this budget.

        **Arguments:**

        - `dof`: degrees of freedom of the noise of the calibration; infinite if the noise is stated.
        """
        sizes = np.vstack([calibrated.sd, self.contributions[:, self.type_b.places(calibrated.names)]])
        return coverage_factors(effective_dof(sizes, np.array([dof, *self.dof])), self.level)

    def combined(self, calibrated: SensorParameters) -> SensorParameters:
        """The parameters of a calibration with their combined covariance: that of the calibration (`noise`) and the inputs."""
        shared = [name for name in calibrated.names if name in self.type_b.names]
        places = calibrated.places(shared)
        covariance = calibrated.covariance.copy()
        covariance[np.ix_(places, places)] += self.type_b.of(shared).covariance
        return replace(calibrated, covariance=covariance, noise=calibrated.covariance)


def read_budget(path: Path) -> BudgetResult:
    """Read a `budget.json`.

    **Raises:** `InputError` for a file that is not a budget of a whole sensor, or has a wrong coverage factor.
    """
    content = read_json_object(path)
    try:
        parameters, level, inputs = content["parameters"], content["level"], content["inputs"]
        stated = {key: [own[key] for own in parameters.values()] for key in ("value", "u_type_a", "k")}
        stated["contributions"] = [[own["contributions"][label] for own in parameters.values()] for label in inputs]
        freedom = {label: own.get("dof") for label, own in inputs.items()}
        sha256 = content["source"]["sha256"]
        missing = [name for name in SENSOR if name not in parameters]
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"{path}: no budget of a whole sensor in it ({error}); make one with tumblecal budget"
        ) from error
    if missing:
        raise InputError(f"{path}: no budget of a whole sensor in it ({', '.join(missing)} missing); make one of it")
    _check_coverage(path, level, dict(zip(parameters, stated["k"], strict=True)))
    names, size = tuple(parameters), len(parameters)
    values = numbers(path, stated, "value", (size,), "parameters.")
    type_b = SensorParameters(names, values, covariance(path, content, size, key="type_b_covariance"))
    type_a = numbers(path, stated, "u_type_a", (size,), "parameters.")
    contributions = numbers(path, stated, "contributions", (len(freedom), size), "parameters.")
    return BudgetResult(
        type_b, type_a, contributions, _freedom(path, freedom), float(level), sha256, "diagnosis" in content
    )


def _freedom(path: Path, stated: Mapping[str, object]) -> Float[np.ndarray, " inputs"]:
    """Degrees of freedom of the inputs.

    **Raises:** `InputError` for what is no such number.
    """
    for label, dof in stated.items():
        if dof is not None and not (is_number(dof) and dof >= _LEAST_DOF):
            raise InputError(
                f"{path}: inputs.{label}.dof: {shown(dof)} is no number of degrees of freedom ({_LEAST_DOF:g} or more); make "
                "the budget again with tumblecal budget"
            )
    return np.array([np.inf if dof is None else dof for dof in stated.values()], float)


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


def with_budget_in_folder(file: Path, calibration: Calibration) -> SensorParameters | None:
    """The parameters of a calibration with combined covariance; None if its folder has no budget of the same data and model."""
    path = file.parent / NAME
    budget = read_budget(path) if path.is_file() else None
    if budget is None or not budget.is_of(calibration) or budget.moved(calibration) or budget.lacks(calibration):
        return None
    return budget.combined(calibration.sensor)
