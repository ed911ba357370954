"""A linear sensor fitted robustly to readings, and how far the readings are from it."""

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.data import PositionSet
from tumblecal.ground.frames import gravity_in_head


# Usual standard deviations for a sensor in its fixture: scale errors, other entries of its matrix (mount angles up to
# some 10 deg), biases in g, and deviations of readings from those of such a sensor (pitch errors of a degree), g.
_USUAL_SCALE, _USUAL_TURN, _USUAL_BIAS_G, _NEAR_G = 0.05, 0.15, 0.1, 0.02
_USUAL = np.eye(4, 3)
_INFORMATION = np.vstack([np.where(np.eye(3), _USUAL_SCALE, _USUAL_TURN), np.full((1, 3), _USUAL_BIAS_G)]) ** -2.0
# Squared deviation of an outlier row, in units of _NEAR_G; no row adds more than this to a misfit.
FAR = 25.0
# Misfits that differ by more than the first separate hypotheses; those that differ by less than the second do not.
SEPARATE, EQUAL = 30.0, 6.0
# Larger means (g) do not occur at rest, for any bias.
RESTING_G = 5.0
# A prediction needs this many positions of a mounting, and within the second number (g) of a sensor's reading this share.
_FEWEST, _FOLLOWS_G, _LEAST_NEAR = 8, 0.1, 0.6


def misfit(
    ideal: Float[np.ndarray, "hypotheses positions 3"], readings: Float[np.ndarray, "positions 3"]
) -> tuple[Float[np.ndarray, " hypotheses"], Float[np.ndarray, " hypotheses"]]:
    """Misfit of readings (g) against ideal readings: a robust sum of squares over a usual sensor, and the share of rows near
    it."""
    cost, unusual = of_rows(ideal, readings)
    return np.sum(cost, axis=1) + unusual, np.mean(cost < FAR / 2.0, axis=1)


def of_rows(
    ideal: Float[np.ndarray, "hypotheses positions 3"], readings: Float[np.ndarray, "positions 3"]
) -> tuple[Float[np.ndarray, "hypotheses positions"], Float[np.ndarray, " hypotheses"]]:
    """Contribution of each row to a misfit, and the contribution of unusual sensor parameters.

    The weights are those of Geman and McClure, from wide to narrow, so that outlier rows do not decide.
    """
    basis = np.concatenate([ideal, np.ones((*ideal.shape[:2], 1))], axis=2)
    sensor = np.broadcast_to(_USUAL, (len(ideal), 4, 3))
    for near in (0.3, 0.1, 0.05, _NEAR_G, _NEAR_G):
        square = np.sum((readings - basis @ sensor) ** 2, axis=2) / near**2
        weighted = basis * ((FAR / (FAR + square)) / near)[:, :, None] ** 2
        # One system of equations for each axis, because the usual sizes of its entries differ.
        normal = (weighted.mT @ basis)[:, None] + _INFORMATION.T[:, :, None] * np.eye(4)
        towards = (weighted.mT @ readings + _INFORMATION * _USUAL).mT
        sensor = np.linalg.solve(normal, towards[..., None])[..., 0].mT
    square = np.sum((readings - basis @ sensor) ** 2, axis=2) / _NEAR_G**2
    return FAR * square / (FAR + square), np.sum(_INFORMATION * (sensor - _USUAL) ** 2, axis=(1, 2))


def ss_with_pitch_errors(
    ideal: Float[np.ndarray, "positions 3"],
    slope: Float[np.ndarray, "positions 3"],
    setting: Float[np.ndarray, " positions"],
    readings: Float[np.ndarray, "positions 3"],
) -> float:
    """Residual sum of squares (g^2) of the non-outlier rows after a fit of a sensor and one error for each pitch setting;
    infinite if all rows are outliers.

    If the spindle is vertical, the spindle angle affects the readings only through these errors.

    **Arguments:**

    - `ideal`: readings of a perfect instrument, g; `slope`: their derivative by the pitch angle, g/rad.
    """
    by_setting = (setting[:, None] == np.unique(setting)).astype(float)
    of_sensor = np.einsum("ni,ab->naib", np.column_stack([ideal, np.ones(len(ideal))]), np.eye(3))
    of_settings = np.einsum("na,ns->nas", slope, by_setting)
    near = of_rows(ideal[None], readings)[0][0] < FAR / 2.0
    if not np.any(near):
        return np.inf
    rows = np.concatenate([of_sensor.reshape(*ideal.shape, -1), of_settings], axis=2)[near]
    rows, deviation = rows.reshape(3 * len(rows), -1), (readings - ideal)[near].ravel()
    return float(np.sum((deviation - rows @ np.linalg.lstsq(rows, deviation, rcond=1e-9)[0]) ** 2))


def predicted(
    data: PositionSet, counted: Bool[np.ndarray, " positions"] | None = None
) -> Float[np.ndarray, "positions 3"] | None:
    """Readings (g) of any linear sensor fitted robustly to each mounting; None without known attitudes, or if the readings do
    not follow one.

    **Arguments:**

    - `counted`: mask of the positions to use; all if omitted.
    """
    if data.hand_held:
        return None
    f = gravity_in_head(data.alpha, data.beta)
    basis, fitted = np.column_stack([f, np.ones(len(f))]), np.empty_like(data.readings)
    used = np.ones(len(data), bool) if counted is None else counted
    for rows in data.mountings.values():
        if np.sum(used & rows) < _FEWEST:
            return None
        reading, design = data.readings[rows].T, basis[rows]
        weight = ((np.abs(reading) < RESTING_G) & used[rows]).astype(float)
        for near in (0.5, 0.3, 0.1, 0.05, 0.05):
            root = np.sqrt(weight)[:, :, None]
            sensor = np.linalg.pinv(design * root, rcond=1e-9) @ (root * reading[:, :, None])
            made = (design @ sensor)[:, :, 0]
            weight = used[rows] / (1.0 + ((reading - made) / near) ** 2) ** 2
        fitted[rows] = made.T
    follows = np.max(np.abs(data.readings - fitted), axis=1) < _FOLLOWS_G
    return fitted if np.mean(follows[used]) > _LEAST_NEAR else None
