"""Parameters of the triad that do not depend on the mounting: input-axis angles, scale factors and biases.

With `M = diag(1 + dK) T R` and any rotation R, `M M'` stays the same: the lengths of M's rows (scale factor along
each true input axis) and the angles between them. The calibration matrix of `calibration.json` is its inverse in the
triad's own orthogonal frame (x along the x input axis, y in the plane of x and y).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Inexact

from tumblecal.data.sensor_parameters import SENSOR, correction_slope, exact_derivative, triad_of
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


def intrinsic(fit: Fit) -> Intrinsic:
    """The mounting-independent parameters of a nominal fit (delta method for the covariance)."""
    here = sensor_places(fit)
    values = fit.values[here]
    slope = exact_derivative(_invariants, values)
    covariance = slope @ fit.covariance[np.ix_(here, here)] @ slope.T
    return Intrinsic(NAMES, UNITS, _invariants(values), covariance)


def matrix_and_bias(fit: Fit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The correction of a device, `f = matrix (A - bias)`.

    **Returns:** matrix (3x3, 1), bias (g), covariance of the matrix' rows followed by the bias (12x12).
    """
    here = sensor_places(fit)
    values = fit.values[here]
    slope = correction_slope(values)
    covariance = slope @ fit.covariance[np.ix_(here, here)] @ slope.T
    return np.linalg.inv(triad_of(values)), values[3:6], covariance


def one_sensor(fit: Fit) -> bool:
    """Whether dK, bias and gamma are all estimated, and one for all data."""
    return all(name in fit.names for name in SENSOR)


def sensor_places(fit: Fit) -> list[int]:
    """Indices of dK, bias and gamma among the fit's parameters.

    **Raises:** `KeyError` when they are not all there.
    """
    missing = [name for name in SENSOR if name not in fit.names]
    if missing:
        raise KeyError(f"no {', '.join(missing)} among the estimated parameters {', '.join(fit.names)}")
    return [fit.names.index(name) for name in SENSOR]


def _invariants(values: Inexact[np.ndarray, "*several 9"]) -> Inexact[np.ndarray, "*several 9"]:
    axes = triad_of(values)
    lengths = np.sqrt(np.sum(axes * axes, axis=-1))  # not norm(): complex steps pass through here
    unit = axes / lengths[..., None]
    cosines = np.sum(unit[..., [0, 0, 1], :] * unit[..., [1, 2, 2], :], axis=-1)
    return np.concatenate([lengths - 1, values[..., 3:6], -np.arcsin(cosines)], axis=-1)
