"""`calibration.json` as one pydantic model, which reads and writes it: keys, types, and consistency of its numbers."""

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from jaxtyping import Float
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from tumblecal.data.calibration_terms import Terms
from tumblecal.data.calibration_use import StatedUse
from tumblecal.data.not_applied import NotApplied
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters, leaf_of, triad_of
from tumblecal.data.temperature_curves_file import StatedTemperature
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import LEAST_MS2, MOST_MS2, record_of
from tumblecal.ground.record import LEFT_OUT
from tumblecal.ground.strict_json import (
    LISTED,
    AsStated,
    Covariance,
    Finite,
    Flag,
    Record,
    Shape,
    Size,
    Text,
    require_covariance,
)


UNITS_OF = {"A": "g", "f": "g", "matrix": "1", "bias": "g", "alignment": "1"}
ORDER = (*(f"matrix_{row}{column}" for row in "123" for column in "123"), "bias_x", "bias_y", "bias_z")
# The matrix of a triad is near 1; readings in a wrong unit give at most a thousand.
MOST_SCALE = 2e3
# Matrix and bias may differ by this much (1, g) from the parameters: more than any rounding, float32 included, and far below
# the uncertainty of a calibration.
_SAME = 1e-6


def require_triad(matrix: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """A matrix that can be that of a triad.

    **Raises:** `InputError`.
    """
    scales = np.linalg.svd(matrix, compute_uv=False)
    if not 1 / MOST_SCALE < scales[-1] <= scales[0] < MOST_SCALE:
        raise InputError(
            f"a matrix with scales from {scales[-1]:.3g} to {scales[0]:.3g} is not that of a triad (about 1)"
        )
    return matrix


def _require_parameter(name: str) -> str:
    if name not in SENSOR and leaf_of(name) != "dtheta":
        raise ValueError(f"no parameter of a triad or its mountings; parameters: {', '.join(SENSOR)}, dtheta_x, ...")
    return name


def _as_written(wanted: Any) -> AfterValidator:
    def same(stated: Any) -> Any:
        if stated != wanted:
            raise ValueError("differs from the value that calibrate writes; restore it")
        return stated

    return AfterValidator(same)


Triple = Annotated[np.ndarray, Shape((3,)), LISTED]
Matrix = Annotated[np.ndarray, Shape((3, 3)), LISTED]


class StatedParameters(Record):
    """The table `parameters`: those of the fit, including mount angles; `determined`: by the data, separately."""

    names: list[Annotated[str, AfterValidator(_require_parameter)]]
    values: Annotated[np.ndarray, Shape((None,)), LISTED]
    covariance: Covariance
    determined: list[Flag] = Field(default_factory=list)

    @model_validator(mode="after")
    def _of_one_triad(self) -> "StatedParameters":
        if missing := [name for name in SENSOR if name not in self.names]:
            raise ValueError(f"names: {', '.join(missing)} missing; they must be as calibrate writes them")
        size = len(self.names)
        if len(set(self.names)) < size:
            raise ValueError("names: must be different texts")
        if "determined" in self.model_fields_set and len(self.determined) != size:
            raise ValueError("determined must be true or false for each name")
        if len(self.values) != size or len(self.covariance) != size:
            raise ValueError(f"values and covariance must be of {size} names; use the file as the program wrote it")
        return self

    @classmethod
    def of(cls, parameters: SensorParameters) -> "StatedParameters":
        """The table of parameters; `determined` only if some are not."""
        names = [*parameters.names]
        stated: dict[str, Any] = {"names": names, "values": parameters.values, "covariance": parameters.covariance}
        if parameters.undetermined:
            stated["determined"] = [name not in parameters.undetermined for name in names]
        return cls.model_construct(**stated)

    def parameters(self) -> SensorParameters:
        """The parameters of this table."""
        undetermined = [name for name, known in zip(self.names, self.determined, strict=False) if not known]
        return SensorParameters(tuple(self.names), self.values, self.covariance, tuple(undetermined))


class StatedGravity(Record):
    """One g in m/s^2 and its source; without a value if the data do not state it."""

    value_ms2: Annotated[Finite, Field(gt=LEAST_MS2, lt=MOST_MS2)] | None
    source: Text


GravityOrNone = Annotated[StatedGravity, BeforeValidator(record_of)]


class AveragedModel(Record):
    """An explanation of a model average: ids of its effects."""

    causes: list[Text] = Field(default_factory=list)


class Provenance(Record):
    """Keys of `provenance` that the program reads again; all others are free."""

    dof: Annotated[Finite, Field(ge=1)] | None = None
    sha256: Text | None = None
    not_applied: list[Text] = Field(default_factory=list)
    losses: list[NotApplied] = Field(default_factory=list)
    causes: list[Text] = Field(default_factory=list)
    averaged_over: list[AveragedModel] = Field(default_factory=list)
    undetected_effects: list[Text] | None = None
    uncertainty_parts: dict[str, dict[str, Size]] | None = None
    temperature_range_degc: Annotated[list[Finite], Field(min_length=2, max_length=2)] | None = None


class CalibrationFile(Record):
    """The keys of a calibration file, in their order; further keys follow."""

    schema_: Annotated[Literal["tumblecal.calibration/1"], Field(alias="schema")]
    equation: Any = None
    matrix: Annotated[Matrix, AfterValidator(require_triad)]
    bias: Triple
    covariance: Annotated[np.ndarray, Shape((12, 12)), AfterValidator(require_covariance), LISTED]
    covariance_order: Annotated[list[str], _as_written([*ORDER])] = Field(default_factory=lambda: [*ORDER])
    alignment: Matrix | None = None
    units: Annotated[dict[str, str], _as_written(UNITS_OF)] = Field(default_factory=UNITS_OF.copy)
    gravity: StatedGravity | None = None
    temperature_degc: Finite | None = None
    serial_number: Text | None = None
    use: Annotated[StatedUse | None, LEFT_OUT] = None
    provenance: Annotated[dict[str, Any], AsStated(Provenance)] = Field(default_factory=dict)
    parameters: Annotated[StatedParameters | None, LEFT_OUT] = None
    temperature: Annotated[StatedTemperature | None, LEFT_OUT] = None
    terms: Annotated[list[Any], AsStated(Terms)] = Field(default_factory=list)


def require_agreement(path: Path, file: CalibrationFile, parameters: SensorParameters) -> None:
    """Check that the parameters of a file agree with its matrix and bias.

    **Raises:** `InputError` if they contradict each other, as after a manual change of one of them.
    """
    matrix, bias, sensor = file.matrix, file.bias, parameters.of(SENSOR).values
    triad = triad_of(sensor)
    far = np.flatnonzero(np.abs(bias - sensor[3:6]) > _SAME * max(1.0, float(np.max(np.abs(bias)))))
    faults = [f"bias.{k}: {bias[k]:.9g} g, but parameters say {sensor[3 + k]:.9g}" for k in far]
    # The matrix undoes the triad of the parameters: their product is 1 whatever unit the readings are in.
    if np.any(np.abs(matrix @ triad - np.eye(3)) > _SAME):
        made = np.linalg.inv(matrix)
        row, column = np.unravel_index(np.argmax(np.abs(made - triad)), (3, 3))
        faults.append(
            f"matrix: its inverse has {made[row, column]:.9g} in row {row + 1}, column {column + 1}, but dK and gamma in "
            f"parameters make {triad[row, column]:.9g}"
        )
    if faults:
        advice = "the file contradicts itself, as after a manual change; use the file of calibrate"
        raise InputError([f"{path}: {fault}: {advice}" for fault in faults])
