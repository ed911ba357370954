"""`budget.json` read back: what a budget adds to a calibration's own uncertainty."""

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
# A factor may have been rounded by so much.
_ROUNDED = 0.99
# Two noises whose standard uncertainties differ by less are one.
_SAME_NOISE = 0.01
# The least degrees of freedom of an input, as `chain.considered` takes it.
_LEAST_DOF = 0.5


@dataclass(frozen=True)
class BudgetResult:
    """A budget's inputs as they act on the parameters, base units.

    - `type_b`: a covariance without the data's noise. `type_a`: standard uncertainties by the noise that it was made with.
    - `contributions`, `dof`: standard uncertainties by each input, and its degrees of freedom.
    - `level`: of its coverage factors. `sha256`: of the data. `diagnosed`: made with the covariance of a diagnosis.
    """

    type_b: SensorParameters
    type_a: Float[np.ndarray, " parameters"]
    contributions: Float[np.ndarray, "inputs parameters"]
    dof: Float[np.ndarray, " inputs"]
    level: float
    sha256: str | None
    diagnosed: bool = False

    def is_of(self, calibration: Calibration) -> bool:
        """Whether both were made from the same data, as far as is known."""
        return not self.sha256 or calibration.provenance.get("sha256") in (None, self.sha256)

    def lacks(self, calibration: Calibration) -> bool:
        """Whether the budget includes the contributions of a diagnosis and the calibration is of none."""
        return self.diagnosed and "verdict" not in calibration.provenance

    def moved(self, calibration: Calibration) -> list[str]:
        """Parameters that are not the budget's to within their own sd, so that it is of another model; none for the extended
        model of a diagnosis, whose budget is that of the nominal one."""
        if "verdict" in calibration.provenance:
            return []
        own, budgeted = calibration.sensor.of(SENSOR), self.type_b.of(SENSOR)
        apart = (np.abs(own.values - budgeted.values) > own.sd) & (own.sd > 0)
        return [name for name, far in zip(SENSOR, apart, strict=True) if far]

    def other_noise(self, calibration: Calibration) -> str:
        """Words on a budget that was made with another noise than the calibration; "" where it is the same, and for the
        extended model of a diagnosis, which shares its noise among other parameters."""
        if "verdict" in calibration.provenance:
            return ""
        there, own = self.type_a[self.type_b.places(SENSOR)], calibration.sensor.of(SENSOR).sd
        far = np.abs(own - there) - _SAME_NOISE * np.maximum(own, there)
        if not np.any(far > 0):
            return ""
        worst = int(np.argmax(far / np.maximum(np.maximum(own, there), 1e-300)))
        unit, factor = shown_unit(GROUPS[leaf_of(SENSOR[worst])][1])
        sizes = [in_words(f"{size * factor:.3g}", unit) for size in (there[worst], own[worst])]
        return f"made with another noise than the calibration (u_A of {SENSOR[worst]}: {sizes[0]}, here {sizes[1]})"

    def coverage(self, own: SensorParameters, dof: float) -> Float[np.ndarray, " parameters"]:
        """Coverage factors of a calibration's parameters (those of `own`) with its own noise beside the inputs.

        **Arguments:**

        - `dof`: degrees of freedom of the calibration's noise; infinite where it is stated.
        """
        sizes = np.vstack([own.sd, self.contributions[:, self.type_b.places(own.names)]])
        return coverage_factors(effective_dof(sizes, np.array([dof, *self.dof])), self.level)

    def combined(self, own: SensorParameters) -> SensorParameters:
        """A calibration's parameters with the combined covariance: their own (`noise`), and what the inputs add."""
        shared = [name for name in own.names if name in self.type_b.names]
        covariance, block = own.covariance.copy(), np.ix_(own.places(shared), own.places(shared))
        covariance[block] += self.type_b.of(shared).covariance
        return replace(own, covariance=covariance, noise=own.covariance)


def read_budget(path: Path) -> BudgetResult:
    """Read a `budget.json`.

    **Raises:** `InputError` for a file that is none, or is not of a whole sensor, and for a coverage factor that is none.
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


def with_budget_beside(file: Path, calibration: Calibration) -> SensorParameters | None:
    """A calibration's parameters with combined covariance, where a budget of the same data and model lies beside its file."""
    path = file.parent / NAME
    budget = read_budget(path) if path.is_file() else None
    if budget is None or not budget.is_of(calibration) or budget.moved(calibration) or budget.lacks(calibration):
        return None
    return budget.combined(calibration.sensor)
