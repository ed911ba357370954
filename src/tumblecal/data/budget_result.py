"""`budget.json`: the contributions of a budget to the uncertainty of a calibration."""

from dataclasses import dataclass, replace
from pathlib import Path
from statistics import NormalDist
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field, model_validator

from tumblecal.data.calibration import Calibration
from tumblecal.data.coverage_factor import coverage_factors, effective_dof
from tumblecal.data.sensor_parameters import SENSOR, UNITS, SensorParameters
from tumblecal.ground.record import at
from tumblecal.ground.strict_json import Covariance, Finite, Record, Size, Text, read_record
from tumblecal.ground.units import in_words
from tumblecal.ground.units import shown as shown_unit


NAME = "budget.json"
# Standard uncertainties with a smaller relative difference are due to the same noise.
_SAME_NOISE = 0.01
# Smallest ratio of a rounded coverage factor to the exact one.
_ROUNDED = 0.99


class BudgetInput(Record):
    """Degrees of freedom of an input, as in `chain.considered`; None: infinitely many."""

    dof: Annotated[Finite, Field(ge=0.5)] | None = None


class BudgetParameter(Record):
    """Value, standard uncertainties (base units) and coverage factor of a parameter."""

    value: Finite
    u_type_a: Size
    contributions: dict[str, Size]
    k: Finite


class BudgetFile(Record):
    """The keys of `budget.json` that the program reads again."""

    schema_: Annotated[Literal["tumblecal.budget_result/1"], Field(alias="schema")]
    sha256: Text | None = at("source.sha256")
    level: Annotated[Finite, Field(ge=0.5, lt=1)]
    inputs: dict[str, BudgetInput]
    parameters: dict[str, BudgetParameter]
    type_b_covariance: Covariance
    diagnosis: list[Text] | None = None

    @model_validator(mode="after")
    def _of_a_whole_sensor(self) -> "BudgetFile":
        if missing := [name for name in SENSOR if name not in self.parameters]:
            raise ValueError(f"parameters: {', '.join(missing)} missing; make a budget of a whole sensor")
        if len(self.type_b_covariance) != len(self.parameters):
            raise ValueError(f"type_b_covariance: must be of {len(self.parameters)} parameters; make the budget again")
        # The factor of a normal distribution is the smallest.
        least = NormalDist().inv_cdf(0.5 + self.level / 2)
        for name, stated in self.parameters.items():
            if missing := [label for label in self.inputs if label not in stated.contributions]:
                raise ValueError(
                    f"parameters.{name}.contributions: {', '.join(missing)} missing; make the budget again"
                )
            if stated.k < _ROUNDED * least:
                raise ValueError(
                    f"parameters.{name}.k: {stated.k:g} is no coverage factor at a probability of {self.level:g}, which is "
                    f"{least:.3g} or more; make the budget again with tumblecal budget"
                )
        return self


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
        unit, factor = shown_unit(UNITS[SENSOR[worst]])
        sizes = [in_words(f"{size * factor:.3g}", unit) for size in (budgeted[worst], calibrated[worst])]
        worst_u = f"u_A of {SENSOR[worst]}: {sizes[0]}, here {sizes[1]}"
        return f"computed with a different noise from that of the calibration ({worst_u})"

    def coverage(self, calibrated: SensorParameters, dof: float) -> Float[np.ndarray, " parameters"]:
        """Coverage factors of the parameters of a calibration, with its noise and the inputs of this budget.

        **Arguments:**

        - `dof`: degrees of freedom of the noise of the calibration; infinite if the noise is stated.
        """
        inputs = self.contributions[:, self.type_b.places(calibrated.names)]
        sizes = np.vstack([*calibrated.sizes, inputs])
        return coverage_factors(effective_dof(sizes, np.array([dof, np.inf, *self.dof])), self.level)

    def combined(self, calibrated: SensorParameters) -> SensorParameters:
        """The parameters of a calibration with their combined covariance: that of the calibration (`noise`) and the inputs."""
        shared = [name for name in calibrated.names if name in self.type_b.names]
        places = calibrated.places(shared)
        covariance = calibrated.covariance.copy()
        covariance[np.ix_(places, places)] += self.type_b.of(shared).covariance
        noise = calibrated.covariance if calibrated.noise is None else calibrated.noise
        return replace(calibrated, covariance=covariance, noise=noise)


def read_budget(path: Path) -> BudgetResult:
    """Read a `budget.json`.

    **Raises:** `InputError` for a file that is not a budget of a whole sensor, or has a wrong coverage factor.
    """
    file = read_record(path, BudgetFile, "make a budget with tumblecal budget")
    parameters, dof = file.parameters, [given.dof for given in file.inputs.values()]
    values, type_a = np.array([(stated.value, stated.u_type_a) for stated in parameters.values()]).T
    contributions = [[stated.contributions[label] for stated in parameters.values()] for label in file.inputs]
    return BudgetResult(
        type_b=SensorParameters(tuple(parameters), values, file.type_b_covariance),
        type_a=type_a,
        contributions=np.array(contributions).reshape(len(dof), len(parameters)),
        dof=np.array([np.inf if each is None else each for each in dof]),
        level=file.level,
        sha256=file.sha256,
        diagnosed=file.diagnosis is not None,
    )


def with_budget_in_folder(file: Path, calibration: Calibration, degc: float | None = None) -> SensorParameters | None:
    """The parameters of a calibration with combined covariance; None if its folder has no budget of the same data and model.

    **Arguments:**

    - `degc`: the temperature of parameters that follow temperature; None: their reference. The contributions of the budget are
      those at the reference.
    """
    path = file.parent / NAME
    budget = read_budget(path) if path.is_file() else None
    if budget is None or not budget.is_of(calibration) or budget.moved(calibration) or budget.lacks(calibration):
        return None
    return budget.combined((calibration if degc is None else calibration.at(degc)).sensor)
