"""The parameters of a sensor as functions of temperature, with their joint covariance and hysteresis.

A parameter is `p(T) = p(T0) + sum of c_k h_k(T)`, with the functions h_k of `TemperatureFunctions`. Its covariance at a
temperature is `J C J^T`, with C of the parameters at T0 and all coefficients, and J = [1, h_k(T)]. Hysteresis is a systematic
difference between rising and falling temperature that no correction includes. Half of it is the half-width of a uniform
distribution, with the standard uncertainty `half_width / sqrt(3)` (JCGM 100, 4.3.7).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
from jaxtyping import Float
from pydantic import ConfigDict

from tumblecal.data.sensor_parameters import GROUPS, SENSOR, SensorParameters, leaf_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted
from tumblecal.ground.showing import brief
from tumblecal.ground.strict_json import Size, Text, one_of
from tumblecal.ground.temperature_functions import TemperatureFunctions


# A temperature may exceed the measured range by the rounding of a number with few digits.
_ROUNDING_DEGC = 1e-3
_USUAL_DEGC = 25.0


def _require_parameter(name: str) -> None:
    if name not in SENSOR:
        raise InputError(f"{name}: no parameter of a sensor; parameters: {', '.join(SENSOR)}")


@dataclass(frozen=True)
class Curve:
    """A parameter as a function of temperature.

    - `parameter`: one of `SENSOR`. `coefficients`: of `functions`, in the unit of the parameter with the divisors of the
      functions (g/degC, g/degC^2, ...).

    **Raises:** `InputError` for an unknown parameter or a wrong number of coefficients.
    """

    __repr__ = brief

    parameter: str
    functions: TemperatureFunctions
    coefficients: Float[np.ndarray, " count"]

    def __post_init__(self) -> None:
        _require_parameter(self.parameter)
        if np.shape(self.coefficients) != (self.functions.count,):
            given = counted(np.size(self.coefficients), "coefficient")
            raise InputError(f"{self.parameter}: {given}, but its functions of temperature need {self.functions.count}")

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the coefficients: `g/degC`, `1/degC^2`, ..."""
        return tuple(GROUPS[leaf_of(self.parameter)][1] + divisor for divisor in self.functions.units)

    @property
    def order(self) -> int:
        """Order of its functions."""
        return self.functions.order

    @property
    def knots_degc(self) -> tuple[float, ...]:
        """Interior knots of its functions."""
        return self.functions.knots_degc

    @property
    def coefficient_names(self) -> tuple[str, ...]:
        """Names of the coefficients: `bias_x/degC`, `bias_x/degC^2`, ..., `bias_x/degC^3@20` for a knot at 20 degC."""
        return tuple(self.parameter + end for end in self.functions.coefficient_ends)


@dataclass(frozen=True)
class Hysteresis:
    """Half of the difference of a parameter between rising and falling temperature: `unit` is g, 1 or rad.

    `not_separated_from`: effects of the history (`hysteresis`, `temperature_lag`, `temperature_rate`) that may be its cause.

    **Raises:** `InputError` for an unknown parameter, a negative half-width, or a unit of a different parameter.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="ignore")

    parameter: Annotated[Text, one_of(SENSOR)]
    half_width: Size
    unit: Text
    not_separated_from: tuple[Text, ...] = ()

    def __post_init__(self) -> None:
        _require_parameter(self.parameter)
        if not 0 <= self.half_width < np.inf:
            raise InputError(f"half_width {self.half_width:g} of {self.parameter}: it must be 0 or more")
        if self.unit != (unit := GROUPS[leaf_of(self.parameter)][1]):
            raise InputError(f"unit {self.unit!r} of {self.parameter}: it must be {unit!r}")


@dataclass(frozen=True)
class TemperatureCurves:
    """Curves of some sensor parameters; all others are constant.

    - `curves`: at most one for each parameter, all with the same reference and range.
    - `covariance`: of all sensor parameters at the reference temperature (in the order of `SENSOR`), then of all coefficients
      in the order of the curves, without hysteresis. `covariance_order`: names of its rows, `order_of_covariance(curves)`.
    - `hysteresis`: at most one for each parameter; constant over the range.

    **Raises:** `InputError` for no curves, or curves, covariance and names that do not agree.

    Examples:
        >>> functions = TemperatureFunctions(1, reference_degc=25.0, range_degc=(0.0, 60.0))
        >>> curve = Curve("bias_x", functions, np.array([1e-4]))
        >>> covariance = np.diag([0.0, 0.0, 0.0, 9e-10, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-12])
        >>> curves = TemperatureCurves((curve,), covariance, order_of_covariance([curve]))
        >>> curves.at(np.array([25.0, 35.0]))[:, SENSOR.index("bias_x")].tolist()  # g
        [0.0, 0.001]
        >>> curves.sd(np.array([25.0, 65.0]))[:, SENSOR.index("bias_x")].round(6).tolist()
        [3e-05, 5e-05]
    """

    __repr__ = brief

    curves: tuple[Curve, ...]
    covariance: Float[np.ndarray, "entries entries"]
    covariance_order: tuple[str, ...]
    hysteresis: tuple[Hysteresis, ...] = ()

    def __post_init__(self) -> None:
        if not self.curves:
            raise InputError("no curves of temperature; state one or more")
        ranges = {(curve.functions.reference_degc, curve.functions.range_degc) for curve in self.curves}
        if len(ranges) > 1:
            raise InputError("the curves have different reference temperatures or ranges; they must be the same")
        for kind, parts in (("curves", self.curves), ("hysteresis", self.hysteresis)):
            names = [part.parameter for part in parts]
            if twice := [name for name in names if names.count(name) > 1]:
                raise InputError(f"two {kind} of {twice[0]}; state one")
        order = order_of_covariance(self.curves)
        if tuple(self.covariance_order) != order:
            raise InputError(f"the order of the covariance must be {', '.join(order)}")
        if np.shape(self.covariance) != (len(order), len(order)):
            shape = " x ".join(map(str, np.shape(self.covariance)))
            raise InputError(f"a covariance of {shape} numbers; it must have {len(order)} rows and columns")

    @property
    def reference_degc(self) -> float:
        """The temperature T0 at which the parameters of the calibration apply."""
        return self.curves[0].functions.reference_degc

    @property
    def range_degc(self) -> tuple[float, float]:
        """Lowest and highest measured temperature."""
        return self.curves[0].functions.range_degc

    @property
    def usual_degc(self) -> float:
        """The temperature at which calibrations of several days are compared: 25 degC if measured, otherwise the reference."""
        return self.reference_degc if self.beyond(np.array([_USUAL_DEGC]))[0] else _USUAL_DEGC

    def at(self, degc: Float[np.ndarray, " rows"]) -> Float[np.ndarray, "rows 9"]:
        """Changes of the sensor parameters since the reference temperature, in the order of `SENSOR`; outside the range too."""
        # In memory parameter by parameter.
        changes = np.zeros((len(SENSOR), len(degc)))
        for curve in self.curves:
            changes[SENSOR.index(curve.parameter)] = curve.coefficients @ curve.functions.values(degc)
        return changes.T

    def covariance_at(self, degc: float, *, hysteresis: bool = True) -> Float[np.ndarray, "9 9"]:
        """Covariance of the sensor parameters at one temperature; also outside the range."""
        jacobian = self.jacobian_at(degc)
        covariance = jacobian @ self.covariance @ jacobian.T
        return covariance + np.diag(self.hysteresis_variance) if hysteresis else covariance

    def jacobian_at(self, degc: float) -> Float[np.ndarray, "9 entries"]:
        """Derivative of the sensor parameters at one temperature by the entries of `covariance`; also outside the range."""
        return self._jacobians(np.array([float(degc)]))[0]

    def sd(self, degc: Float[np.ndarray, " rows"]) -> Float[np.ndarray, "rows 9"]:
        """Standard uncertainties of the sensor parameters at temperatures, with hysteresis; also outside the range."""
        jacobians = self._jacobians(degc)
        variances = np.einsum("rpe,ef,rpf->rp", jacobians, self.covariance, jacobians, optimize=True)
        return np.sqrt(np.maximum(variances, 0.0) + self.hysteresis_variance)

    @property
    def hysteresis_variance(self) -> Float[np.ndarray, "9"]:
        """The variances of the sensor parameters that are due to hysteresis."""
        variance = np.zeros(len(SENSOR))
        for part in self.hysteresis:
            variance[SENSOR.index(part.parameter)] = part.half_width**2 / 3
        return variance

    def with_hysteresis(self, sensor: SensorParameters) -> SensorParameters:
        """Parameters with the uncertainty by hysteresis in addition, which is no part of the noise."""
        variance = np.zeros(len(sensor.names))
        variance[sensor.places(SENSOR)] = self.hysteresis_variance
        if not np.any(variance):
            return sensor
        noise = sensor.covariance if sensor.noise is None else sensor.noise
        return replace(sensor, covariance=sensor.covariance + np.diag(variance), noise=noise)

    def beyond(self, degc: Float[np.ndarray, " rows"]) -> np.ndarray:
        """Whether each temperature is outside the measured range."""
        low, high = self.range_degc
        return (degc < low - _ROUNDING_DEGC) | (degc > high + _ROUNDING_DEGC)

    def require_range(self, degc: Float[np.ndarray, " rows"], *, extrapolate: bool) -> None:
        """Check that temperatures are numbers, and within the measured range unless `extrapolate` is set.

        **Raises:** `InputError`.
        """
        if missing := int(np.count_nonzero(~np.isfinite(degc))):
            raise InputError(
                f"{missing} of {counted(len(degc), 'temperature')} are not finite numbers; remove their rows"
            )
        if not extrapolate and (count := int(np.count_nonzero(beyond := self.beyond(degc)))):
            ends = (
                f"{np.min(degc[beyond]):.4g} to {np.max(degc[beyond]):.4g}" if count > 1 else f"{degc[beyond][0]:.4g}"
            )
            raise InputError(
                f"{count} of {counted(len(degc), 'temperature')} outside the measured {self.range_words} ({ends} degC): "
                "the calibration is not known there. extrapolate=True overrides this"
            )

    @property
    def range_words(self) -> str:
        """The measured range: `0 to 60 degC`."""
        low, high = self.range_degc
        return f"{low:.4g} to {high:.4g} degC"

    @property
    def words(self) -> str:
        """Reference, range and orders: `at 25 degC; by temperature from 0 to 60 degC: bias_x order 3, dK_z order 1`."""
        orders = list[str]()
        for curve in self.curves:
            knots = len(curve.functions.knots_degc)
            kind = "linear" if curve.functions.order == 1 else "cubic"
            order = f"{kind} spline with {counted(knots, 'knot')}" if knots else f"order {curve.functions.order}"
            orders.append(f"{curve.parameter} {order}")
        return f"at {self.reference_degc:.4g} degC; by temperature from {self.range_words}: {', '.join(orders)}"

    def _jacobians(self, degc: np.ndarray) -> Float[np.ndarray, "rows 9 entries"]:
        jacobians = np.zeros((len(degc), len(SENSOR), len(self.covariance_order)))
        jacobians[:, range(len(SENSOR)), range(len(SENSOR))] = 1.0
        first = len(SENSOR)
        for curve in self.curves:
            last = first + curve.functions.count
            jacobians[:, SENSOR.index(curve.parameter), first:last] = curve.functions.values(degc).T
            first = last
        return jacobians


def order_of_covariance(curves: Sequence[Curve]) -> tuple[str, ...]:
    """Names of the rows of the joint covariance: the parameters at the reference temperature, then the coefficients."""
    return (*SENSOR, *(name for curve in curves for name in curve.coefficient_names))
