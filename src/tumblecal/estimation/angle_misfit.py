"""How badly readings follow the attitudes of a hypothesis: whether a sensor of usual size would read them there."""

import numpy as np
from jaxtyping import Float


# Sd of what is usual of a sensor as it stands in its fixture: scale errors, the other entries of its matrix (mounts to
# some 10 deg), biases in g, and how far readings stay from such a sensor's (pitch errors of a degree), g.
_USUAL_SCALE, _USUAL_TURN, _USUAL_BIAS_G, _NEAR_G = 0.05, 0.15, 0.1, 0.02
# The square, in _NEAR_G, at which a row counts as far off; none adds more to a misfit than this.
FAR = 25.0
# Misfits that differ by more than this tell hypotheses apart, by less than that do not.
APART, ALIKE = 30.0, 6.0


def misfit(
    ideal: Float[np.ndarray, "hypotheses positions 3"], readings: Float[np.ndarray, "positions 3"]
) -> tuple[Float[np.ndarray, " hypotheses"], Float[np.ndarray, " hypotheses"]]:
    """How badly readings, g, follow ideal ones: a robust sum of squares over a usual sensor, and the share of rows near it.

    The weights are those of Geman and McClure, from wide to narrow, so that rows far off do not decide.
    """
    cost, unusual = of_rows(ideal, readings)
    return np.sum(cost, axis=1) + unusual, np.mean(cost < FAR / 2.0, axis=1)


def of_rows(
    ideal: Float[np.ndarray, "hypotheses positions 3"], readings: Float[np.ndarray, "positions 3"]
) -> tuple[Float[np.ndarray, "hypotheses positions"], Float[np.ndarray, " hypotheses"]]:
    """What each row adds to a misfit, and what the sensor does by being unusual."""
    basis = np.concatenate([ideal, np.ones((*ideal.shape[:2], 1))], axis=2)
    usual = np.eye(4, 3)
    weight = np.where(usual, _USUAL_SCALE, _USUAL_TURN) ** -2.0
    weight[3] = _USUAL_BIAS_G**-2.0
    sensor = np.broadcast_to(usual, (len(ideal), 4, 3))
    for near in (0.3, 0.1, 0.05, _NEAR_G, _NEAR_G):
        square = np.sum((readings - basis @ sensor) ** 2, axis=2) / near**2
        weighted = basis * ((FAR / (FAR + square)) / near)[:, :, None] ** 2
        # Each axis has a system of its own: what is usual of its entries differs.
        normal = (np.swapaxes(weighted, 1, 2) @ basis)[:, None] + weight.T[:, :, None] * np.eye(4)
        right = np.swapaxes(np.swapaxes(weighted, 1, 2) @ readings + weight * usual, 1, 2)
        sensor = np.swapaxes(np.linalg.solve(normal, right[..., None])[..., 0], 1, 2)
    square = np.sum((readings - basis @ sensor) ** 2, axis=2) / _NEAR_G**2
    return FAR * square / (FAR + square), np.sum(weight * (sensor - usual) ** 2, axis=(1, 2))


def left_by_pitch_errors(
    ideal: Float[np.ndarray, "positions 3"],
    slope: Float[np.ndarray, "positions 3"],
    setting: Float[np.ndarray, " positions"],
    readings: Float[np.ndarray, "positions 3"],
) -> float:
    """What a sensor and an error of each pitch setting leave of the rows near, g^2: where the spindle points up its angle turns
    the readings by those errors alone.

    **Arguments:**

    - `ideal`: what a perfect instrument reads, g; `slope`: its derivative by the pitch angle, g/rad.
    """
    by_setting = (setting[:, None] == np.unique(setting)).astype(float)
    of_sensor = np.einsum("ni,ab->naib", np.column_stack([ideal, np.ones(len(ideal))]), np.eye(3))
    of_settings = np.einsum("na,ns->nas", slope, by_setting)
    near = of_rows(ideal[None], readings)[0][0] < FAR / 2.0
    rows = np.concatenate([of_sensor.reshape(*ideal.shape, -1), of_settings], axis=2)[near]
    rows, off = rows.reshape(3 * len(rows), -1), (readings - ideal)[near].ravel()
    return float(np.sum((off - rows @ np.linalg.lstsq(rows, off, rcond=1e-9)[0]) ** 2))
