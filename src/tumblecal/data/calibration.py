"""`calibration.json`: the correction of a device, `f = matrix (A - bias)`."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration_extended import corrected
from tumblecal.data.calibration_file import (
    ORDER,
    UNITS_OF,
    CalibrationFile,
    StatedGravity,
    StatedParameters,
    require_agreement,
)
from tumblecal.data.calibration_terms import Term, terms_of
from tumblecal.data.calibration_use import NOT_STATED, Use
from tumblecal.data.not_applied import NotApplied, not_applied
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters, correction_slope, of_matrix, triad_of
from tumblecal.data.temperature_curves import TemperatureCurves
from tumblecal.data.temperature_curves_file import StatedTemperature
from tumblecal.data.triad import Triad
from tumblecal.ground.atomic import write_text
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import Gravity, record_of
from tumblecal.ground.showing import Screen, Shown
from tumblecal.ground.strict_json import read_record


SCHEMA = "tumblecal.calibration/1"
# Keys of the file that are attributes of the calibration.
_SAME = ("matrix", "bias", "covariance", "alignment", "temperature_degc", "serial_number", "provenance")


@dataclass(frozen=True, repr=False)
class Calibration(Shown):
    """The linear correction of a triad.

    `matrix` converts readings minus `bias` (g) to specific force in the orthogonal frame of the triad: x along the x
    input axis, y in the plane of the x and y input axes. `covariance` is in the order of `ORDER`. `alignment` rotates
    vectors from that frame to the fixture, `f_fixture = alignment f`; None for data with several mountings. `gravity` is
    the value of one g; None if the data do not state it. `parameters` are those of the fit, including mount angles; None
    in files of earlier versions. `use`: whether it may be used. `extra` has the other keys of the file.

    `temperature`: the parameters as functions of temperature. If given, matrix, bias, covariance (without hysteresis) and
    parameters apply at its reference temperature, and `corrected` needs the temperature of each row.

    Examples:
        >>> import numpy as np
        >>> from tumblecal.data import Calibration
        >>> calibration = Calibration(np.diag([1.001, 1.0, 1.0]), np.array([0.001, 0.0, 0.0]), np.zeros((12, 12)))
        >>> calibration.corrected(np.array([[1.001, 0.0, 0.0]])).round(6).tolist()  # g
        [[1.001, 0.0, 0.0]]
    """

    matrix: Float[np.ndarray, "3 3"]
    bias: Float[np.ndarray, "3"]
    covariance: Float[np.ndarray, "12 12"]
    alignment: Float[np.ndarray, "3 3"] | None = None
    temperature_degc: float | None = None
    serial_number: str | None = None
    gravity: Gravity | None = None
    provenance: dict[str, Any] = field(default_factory=dict)
    extra: dict[str, Any] = field(default_factory=dict)
    parameters: SensorParameters | None = None
    use: Use = NOT_STATED
    temperature: TemperatureCurves | None = None

    @property
    def dof(self) -> float | None:
        """Degrees of freedom of the estimated noise in `covariance` (`provenance["dof"]`); infinite for stated noise, None in
        files of earlier versions, which do not state them."""
        if "dof" not in self.provenance:
            return None
        stated = self.provenance["dof"]
        return math.inf if stated is None else max(float(stated), 1.0)

    @property
    def sensor(self) -> SensorParameters:
        """Scale factors, biases, non-orthogonalities and fitted mount angles, with `dof`; without a stated `dof` the covariance
        is treated as known. With curves of temperature: at their reference temperature, with the uncertainty by hysteresis."""
        sensor = self._sensor
        if self.temperature is not None:
            sensor = self.temperature.with_hysteresis(sensor)
        return sensor if self.dof is None else replace(sensor, dof=self.dof)

    @property
    def _sensor(self) -> SensorParameters:
        return self.parameters or of_matrix(self.matrix, self.bias, self.covariance)

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """Contributions to a reading in addition to matrix and bias: nonlinear, thermal and drift terms.

        **Raises:** `InputError` for invalid terms in `extra`.
        """
        return terms_of(self.extra.get("terms", []))

    @property
    def columns_needed(self) -> tuple[str, ...]:
        """Columns that its curves and terms require in addition to the readings: `temperature_degc`, `time_s`."""
        thermal = self.temperature is not None or any(term.thermal for term in self.terms)
        timed = any(term.per_hour for term in self.terms)
        return (*["temperature_degc"] * thermal, *["time_s"] * timed)

    @property
    def not_applied(self) -> list[NotApplied]:
        """Corrections without a term in the file, with reason and size."""
        return not_applied(self.provenance)

    def require_unit(self, path: Path, source: str, serial: str | None, *, other: bool) -> None:
        """Reject readings of a different unit.

        **Arguments:**

        - `path`: of this calibration. `source`, `serial`: of the readings. `other`: whether the user insists.

        **Raises:** `InputError`.
        """
        if self.serial_number and serial and serial != self.serial_number and not other:
            raise InputError(
                f"{source}: serial number {serial}, but {path} is of {self.serial_number}; give that unit's calibration, or "
                "--other-unit to insist"
            )

    def with_terms(self, terms: Sequence[Term]) -> "Calibration":
        """The calibration with these terms in place of its terms."""
        extra = {key: value for key, value in self.extra.items() if key != "terms"}
        return replace(self, extra=extra | ({"terms": [term.record() for term in terms]} if terms else {}))

    def at(self, degc: float, *, extrapolate: bool = False) -> "Calibration":
        """The calibration at one temperature, without curves of temperature; itself if it has none.

        Matrix, bias and covariance are those at this temperature, with the uncertainty by hysteresis. `parameters` are those
        of the sensor, and at the reference temperature the mount angles. The terms are unchanged.

        **Arguments:**

        - `extrapolate`: whether the temperature may be outside the measured range, where the uncertainty grows.

        **Raises:** `InputError` for a temperature outside the measured range.
        """
        curves = self.temperature
        if curves is None:
            return self
        rows = np.array([float(degc)])
        curves.require_range(rows, extrapolate=extrapolate)
        reference, triad = self._sensor.of(SENSOR), self._triad(rows)
        values = reference.values + curves.at(rows)[0]
        sensor = replace(reference, values=values, covariance=curves.covariance_at(degc, hysteresis=False), noise=None)
        sensor, slope = curves.with_hysteresis(sensor), correction_slope(values)
        return replace(
            self,
            matrix=triad.matrix[0],
            bias=triad.bias[0],
            covariance=slope @ sensor.covariance @ slope.T,
            temperature_degc=float(degc),
            parameters=curves.with_hysteresis(self._sensor) if degc == curves.reference_degc else sensor,
            extra={key: value for key, value in self.extra.items() if key != "covariance_with_terms"},
            temperature=None,
        )

    def _triad(self, degc: Float[np.ndarray, " rows"] | None) -> Triad:
        """The linear correction of rows at these temperatures."""
        if self.temperature is None or degc is None:
            lower = np.linalg.inv(self.matrix)
            return Triad(self.matrix, self.bias, lower / np.diag(lower)[:, None])
        reference, changes = self._sensor.of(SENSOR).values, self.temperature.at(degc)
        values, rotation = reference + changes, self.matrix @ triad_of(reference)
        scale = 1 + values[:, :3]
        axes = triad_of(values) / scale[..., None]
        # The inverse of T = 1 + N, N below the diagonal, is 1 - N + N N, with one number in N N.
        inverse = 2 * np.eye(3) - axes
        inverse[:, 2, 0] += axes[:, 2, 1] * axes[:, 1, 0]
        inverse /= scale[:, None, :]
        return Triad(rotation @ inverse, self.bias + changes[:, 3:6], axes @ np.linalg.inv(rotation))

    def linear(self, readings: Float[np.ndarray, "rows 3"]) -> Float[np.ndarray, "rows 3"]:
        """Matrix and bias applied to readings in g, without the terms and the curves of temperature."""
        return (readings - self.bias) @ self.matrix.T

    def corrected(
        self,
        readings: Float[np.ndarray, "rows 3"],
        temperature_degc: Float[np.ndarray, " rows"] | float | None = None,
        time_s: Float[np.ndarray, " rows"] | float | None = None,
        *,
        extrapolate: bool = False,
    ) -> Float[np.ndarray, "rows 3"]:
        """Specific force in g from readings in g, with curves of temperature, and nonlinear, thermal and drift terms.

        **Arguments:**

        - `temperature_degc`, `time_s`: of each row, or one for all rows; required if curves or a term depend on it.
        - `extrapolate`: whether temperatures may be outside the measured range of the curves.

        **Raises:** `InputError` as `calibration_extended.corrected` does, for an invalid term, and for temperatures outside the
        range of curves.
        """
        if self.temperature is not None and temperature_degc is not None:
            self.temperature.require_range(np.atleast_1d(np.asarray(temperature_degc, float)), extrapolate=extrapolate)
        return corrected(self._triad, self.terms, self.columns_needed, readings, temperature_degc, time_s)

    @property
    def rows(self) -> list[list[str]]:
        """Matrix and bias (mg) as rows of a table, one for each axis."""
        return [
            [f"f_{axis}", *(f"{value:.9f}" for value in self.matrix[k]), f"{self.bias[k] * 1e3:.6f}"]
            for k, axis in enumerate(AXES)
        ]

    def screen(self) -> Screen:
        """Matrix and bias, with the conditions of their use."""
        terms = (
            [f"{len(self.extra['terms'])} nonlinear or thermal terms in addition"] if self.extra.get("terms") else []
        )
        facts = [f"one g is {self.gravity}"] if self.gravity else []
        if self.temperature is not None:
            facts.append(self.temperature.words)
        elif self.temperature_degc is not None:
            facts.append(f"at {self.temperature_degc:.4g} degC")
        unit = f" of {self.serial_number}" if self.serial_number else ""
        return Screen(
            f"Calibration{unit}: f = matrix (A - bias), f and A in g",
            ("", "matrix A_x", "A_y", "A_z", "bias / mg"), self.rows, [f"use: {self.use.words}", *terms, *facts],
        )  # fmt: skip


def write_calibration(path: Path, calibration: Calibration) -> None:
    """Write a calibration file, completely or not at all.

    **Raises:** `InputError` for a file that cannot be written.

    Examples:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> import numpy as np
        >>> from tumblecal.data import Calibration, read_calibration, write_calibration
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "calibration.json")
        ...     write_calibration(file, Calibration(np.eye(3), np.zeros(3), np.zeros((12, 12)), serial_number="A-17"))
        ...     print(read_calibration(file).serial_number)
        A-17
    """
    write_text(path, calibration_text(calibration))


def calibration_text(calibration: Calibration) -> str:
    """The text of a calibration file."""
    file = CalibrationFile.model_construct(
        schema=SCHEMA,
        equation="f = matrix (A - bias); f_fixture = alignment f",
        covariance_order=[*ORDER],
        units=UNITS_OF,
        gravity=StatedGravity.model_construct(**record_of(calibration.gravity)),
        use=calibration.use if calibration.use.answer else None,
        parameters=calibration.parameters and StatedParameters.of(calibration.parameters),
        temperature=calibration.temperature and StatedTemperature.of(calibration.temperature),
        **{name: getattr(calibration, name) for name in _SAME},
        **calibration.extra,
    )
    return json.dumps(file.model_dump(by_alias=True, exclude_unset=True), indent=1, allow_nan=False) + "\n"


def read_calibration(path: Path | str) -> Calibration:
    """Read a calibration file.

    **Raises:** `InputError` for a file that is not a calibration: a missing or infinite number, a singular matrix, an invalid
    covariance, invalid parameters, terms or use, or parameters that contradict matrix and bias.

    Examples:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> import numpy as np
        >>> import tumblecal
        >>> from tumblecal.data import Calibration, write_calibration
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "calibration.json")
        ...     write_calibration(file, Calibration(np.eye(3), np.array([0.001, 0.0, 0.0]), np.zeros((12, 12))))
        ...     calibration = tumblecal.load(file)
        >>> calibration.corrected(np.array([[0.001, 0.0, 1.0]])).tolist()  # g
        [[0.0, 0.0, 1.0]]
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: a folder; give the file, {path / 'calibration.json'}")
    file = read_record(path, CalibrationFile, "give the calibration.json of calibrate")
    gravity = file.gravity
    parameters = None if file.parameters is None else file.parameters.parameters()
    if parameters is not None:
        require_agreement(path, file, parameters)
    return Calibration(
        gravity=None if gravity is None or gravity.value_ms2 is None else Gravity(gravity.value_ms2, gravity.source),
        parameters=parameters,
        use=file.use or NOT_STATED,
        temperature=None if file.temperature is None else file.temperature.curves_of_temperature(),
        extra=(file.model_extra or {}) | ({"terms": file.terms} if "terms" in file.model_fields_set else {}),
        **{name: getattr(file, name) for name in _SAME},
    )
