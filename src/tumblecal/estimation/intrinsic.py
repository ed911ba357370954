"""Parameters of the triad that do not depend on the mounting: input-axis angles, scale factors and biases.

With `M = diag(1 + dK) T R` and any rotation R, `M M'` stays the same: the lengths of M's rows (scale factor along
each true input axis) and the angles between them. The calibration matrix of `calibration.json` is its inverse in the
triad's own orthogonal frame (x along the x input axis, y in the plane of x and y).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Inexact

from tumblecal.data.sensor_parameters import SENSOR, SensorParameters, correction_slope, exact_derivative, triad_of
from tumblecal.estimation.fit import Fit


NAMES = ("scale_x", "scale_y", "scale_z", "bias_x", "bias_y", "bias_z", "angle_xy", "angle_xz", "angle_yz")
UNITS = ("1", "1", "1", "g", "g", "g", "rad", "rad", "rad")


@dataclass(frozen=True)
class Intrinsic:
    """Scale factor errors along the input axes, biases, and the input axes' angles less 90 degrees, with covariance."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Float[np.ndarray, "9"]
    covariance: Float[np.ndarray, "9 9"]

    @property
    def sd(self) -> Float[np.ndarray, "9"]:
        """Standard uncertainties."""
        return np.sqrt(np.diag(self.covariance))


def intrinsic(fit: Fit) -> Intrinsic:
    """The mounting-independent parameters of a nominal fit (delta method for the covariance)."""
    sensor = sensor_of(fit)
    slope = exact_derivative(_invariants, sensor.values)
    return Intrinsic(NAMES, UNITS, _invariants(sensor.values), slope @ sensor.covariance @ slope.T)


def matrix_and_bias(fit: Fit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The correction of a device, `f = matrix (A - bias)`.

    **Returns:** matrix (3x3, 1), bias (g), covariance of the matrix' rows followed by the bias (12x12).
    """
    sensor = sensor_of(fit)
    slope = correction_slope(sensor.values)
    return np.linalg.inv(triad_of(sensor.values)), sensor.values[3:6], slope @ sensor.covariance @ slope.T


def one_sensor(fit: Fit) -> bool:
    """Whether dK, bias and gamma are one for all data, estimated or fixed, and one of them is estimated."""
    return set(SENSOR) <= fit.stated_values.keys() and any(name in fit.names for name in SENSOR)


def sensor_of(fit: Fit, names: tuple[str, ...] = SENSOR) -> SensorParameters:
    """dK, bias and gamma of a fit, or the parameters `names`. The variance of a fixed parameter is zero.

    **Raises:** `KeyError` when one is missing, or not one for all data.
    """
    values = fit.stated_values
    if missing := [name for name in names if name not in values]:
        raise KeyError(f"no {', '.join(missing)} among the parameters {', '.join(values)}")
    estimated = np.array(names)[:, None] == np.array(fit.names)
    covariance = estimated @ fit.covariance @ estimated.T
    undetermined = tuple(name for name in names if name in fit.undetermined)
    return SensorParameters(names, np.array([values[name] for name in names]), covariance, undetermined)


def _invariants(values: Inexact[np.ndarray, "*several 9"]) -> Inexact[np.ndarray, "*several 9"]:
    axes = triad_of(values)
    lengths = np.sqrt(np.sum(axes * axes, axis=-1))  # not norm(): complex steps pass through here
    unit = axes / lengths[..., None]
    cosines = np.sum(unit[..., [0, 0, 1], :] * unit[..., [1, 2, 2], :], axis=-1)
    return np.concatenate([lengths - 1, values[..., 3:6], -np.arcsin(cosines)], axis=-1)
