"""The sensor parameters that a calibration predicts for a recording, with their uncertainty, and the readings without its
terms.

During a recording the parameters are `p = J x + n`. The state x are the parameters at the reference temperature and the
coefficients of the curves (J = [1, h_k(T)]) or of the terms (J = [1, 0]), with the covariance of the calibration and of its
budget. The common error n is
that of this recording alone: hysteresis, stated repeatability from one switch-on to the next, and the uncertainty of gravity,
which scales all three axes.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from tumblecal.data.budget_result import with_budget_in_folder
from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import WITH_TERMS
from tumblecal.data.positions import PositionSet
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters, derivative, of_matrix
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError


# Temperatures may exceed those of a calibration without curves by this much, as for `apply`.
_WARMER_DEGC = 1.0


@dataclass(frozen=True)
class Expected:
    """The parameters during a recording, in the order of `SENSOR`.

    - `state`, `covariance`: x and its covariance, base units. `slope` (9, state): J. `common` (9, 9): covariance of n.
    - `mean`: of p. `sensor`: p without n, with the degrees of freedom of its noise.
    - `degc`: temperature of the recording; None if not known. `size`: gravity there over that of the calibration.
    """

    calibration: Calibration
    state: Float[np.ndarray, " state"]
    covariance: Float[np.ndarray, "state state"]
    slope: Float[np.ndarray, "9 state"]
    common: Float[np.ndarray, "9 9"]
    mean: Float[np.ndarray, "9"]
    sensor: SensorParameters
    degc: float | None
    size: float

    @property
    def of_parameters(self) -> Float[np.ndarray, "9 9"]:
        """Covariance of p without the common error."""
        return self.slope @ self.covariance @ self.slope.T


def expected(
    calibration: Calibration,
    path: Path,
    degc: float | None,
    *,
    size: float = 1.0,
    size_sd: float = 0.0,
    repeatability: Float[np.ndarray, "9"] | None = None,
) -> Expected:
    """The parameters that a calibration predicts.

    **Arguments:**

    - `path`: of the file; a budget in its folder is included. `degc`: temperature of the recording.
    - `size`, `size_sd`: gravity at the place of the recording over that of the calibration, and its standard uncertainty.
    - `repeatability`: standard deviations of the parameters between measurements, base units; none if omitted.

    **Raises:** `InputError` for a calibration without uncertainty.
    """
    curves = calibration.temperature
    at = calibration if curves is None or degc is None else calibration.at(degc, extrapolate=True)
    plain = at.sensor.of(SENSOR)
    if curves is None and "verdict" in calibration.provenance:
        # Of a diagnosis, the covariance of matrix and bias includes undetected effects; it is for corrected readings.
        stated = of_matrix(calibration.matrix, calibration.bias, calibration.covariance)
        plain = replace(plain, covariance=stated.covariance)
    budgeted = with_budget_in_folder(path, calibration, None if curves is None else at.temperature_degc)
    sensor = plain if budgeted is None else budgeted.of(SENSOR)
    of_inputs = np.zeros((9, 9))
    if budgeted is not None:
        of_inputs = sensor.covariance - at.sensor.of(SENSOR).covariance
        sensor = replace(sensor, covariance=plain.covariance + of_inputs, noise=plain.covariance)
    hysteresis = np.zeros((9, 9)) if curves is None else np.diag(curves.hysteresis_variance)
    if curves is None:
        coefficients, covariance = _with_terms(calibration, sensor.covariance)
        covariance[:9, :9] += of_inputs if len(coefficients) else 0.0
        state = np.concatenate([sensor.values, coefficients])
        slope = np.eye(9, len(state))
    else:
        reference = calibration.sensor.of(SENSOR).values
        state = np.concatenate([reference, *(curve.coefficients for curve in curves.curves)])
        covariance = curves.covariance.copy()
        covariance[:9, :9] += of_inputs
        slope = curves.jacobian_at(float(degc or curves.reference_degc))
    # A larger gravity has the same effect as larger scale factors of all axes.
    scale = np.concatenate([1 + sensor.values[:3], np.zeros(6)])
    mean = sensor.values + (size - 1) * scale
    lacking = [name for name, variance in zip(SENSOR, np.diag(sensor.covariance), strict=True) if not variance > 0]
    if lacking:
        raise InputError(
            f"{path}: no standard uncertainty of {', '.join(lacking)}, so a change cannot be tested; use the file that "
            "calibrate or thermal wrote"
        )
    common = hysteresis + size_sd**2 * np.outer(scale, scale)
    if repeatability is not None:
        common = common + np.diag(repeatability**2)
    return Expected(calibration, state, covariance, slope, common, mean, sensor, degc, size)


def _with_terms(
    calibration: Calibration, alone: Float[np.ndarray, "9 9"]
) -> tuple[Float[np.ndarray, " terms"], Float[np.ndarray, "state state"]]:
    """Coefficients of the terms, and the joint covariance of parameters and coefficients; none, and `alone`, if the file does
    not state it."""
    stated = np.array((calibration.extra.get(WITH_TERMS) or {}).get("covariance") or [])
    coefficients = np.array([term.coefficient for term in calibration.terms])
    size = 12 + len(coefficients)
    if not len(coefficients) or stated.shape != (size, size):
        return np.zeros(0), alone.copy()

    def parameters(flat: np.ndarray) -> np.ndarray:
        return of_matrix(flat[:9].reshape(3, 3), flat[9:12], np.zeros((12, 12))).values

    flat = np.concatenate([calibration.matrix.ravel(), calibration.bias])
    slope = np.zeros((9 + len(coefficients), size))
    slope[:9, :12], slope[9:, 12:] = derivative(parameters, flat), np.eye(len(coefficients))
    return coefficients, slope @ stated @ slope.T


def responses(
    calibration: Calibration, data: PositionSet, before: Expected
) -> Float[np.ndarray, "positions terms 3"] | None:
    """Derivatives of the readings by those coefficients of terms that are in the state; None without any."""
    if calibration.temperature is not None or len(before.state) == 9:
        return None
    force = calibration.linear(data.readings)
    found = np.zeros((len(data), len(calibration.terms), 3))
    for k, term in enumerate(calibration.terms):
        if not term.per_hour:
            factor = replace(term, coefficient=1.0).factor(data.temperature_degc, None)
            found[:, k, AXES.index(term.axis)] = term.of_inputs(force) * factor
    return found


def without_terms(calibration: Calibration, data: PositionSet, degc: float | None) -> PositionSet:
    """The readings that a triad without terms would have at one temperature.

    Contributions of nonlinear and thermal terms, and of the temperature of each position, are subtracted. Drift terms belong
    to the measurement of the calibration, and are ignored.

    **Raises:** `InputError` for positions without the temperatures that the calibration needs.
    """
    terms = [term for term in calibration.terms if not term.per_hour]
    if not terms and calibration.temperature is None:
        return data
    steady, warmth = calibration.with_terms(terms), data.temperature_degc
    if warmth is None and "temperature_degc" in steady.columns_needed:
        raise InputError(
            f"{data.source}: no temperatures, but the parameters of the calibration depend on them; give the column by "
            "--columns temperature=..., or record it"
        )
    force = steady.corrected(data.readings, warmth, extrapolate=True)
    triad = steady if degc is None else steady.at(degc, extrapolate=True)
    return replace(data, readings=force @ np.linalg.inv(triad.matrix).T + triad.bias)


def require_temperature(
    calibration: Calibration, path: Path, data: PositionSet, *, extrapolate: bool
) -> Float[np.ndarray, "2"] | None:
    """Check that the temperatures of a recording are within those of the calibration.

    **Returns:** lowest and highest temperature outside the range, if `extrapolate` is set; None for a recording within it, or
    if one of the two states no temperature.

    **Raises:** `InputError` for temperatures outside, unless `extrapolate` is set.
    """
    warmth, curves = data.temperature_degc, calibration.temperature
    stated = calibration.use.temperature_degc or calibration.provenance.get("temperature_range_degc")
    if curves is not None:
        stated, margin = curves.range_degc, 1e-3
    else:
        margin = _WARMER_DEGC
        if stated is None and calibration.temperature_degc is not None:
            stated = (calibration.temperature_degc, calibration.temperature_degc)
    if warmth is None or stated is None:
        return None
    low, high = stated
    outside = warmth[(warmth < low - margin) | (warmth > high + margin)]
    if not len(outside):
        return None
    ends = np.array([outside.min(), outside.max()])
    if not extrapolate:
        at = f"{ends[0]:.4g}" if ends[0] == ends[1] else f"{ends[0]:.4g} to {ends[1]:.4g}"
        known = f"{low:.4g} to {high:.4g}" if low != high else f"{low:.4g}"
        raise InputError(
            f"{data.source}: recorded at {at} degC, but {path} is valid at {known} degC: a change by temperature would look "
            "like a change of the sensor; record within the range, or give --extrapolate to insist"
        )
    return ends
