"""The frame chain once more, for comparison: numpy and scipy's Rotation, written from DESIGN section 1 alone.

Nothing of tumblecal's own chain is imported. Where the program turns component by component, this file turns with
scipy's quaternions; where the program differentiates, this file fits with scipy's finite differences.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation


def passive(axis: str, angle: np.ndarray) -> Rotation:
    """Coordinate rotation about one axis: the inverse of the active one that scipy means."""
    unit = np.eye(3)["xyz".index(axis)]
    return Rotation.from_rotvec(np.multiply.outer(np.asarray(angle), unit)).inv()


@dataclass(frozen=True)
class Instrument:
    """True parameters; `dbeta` is given for every position, `dtheta`, `dK`, `bias` for all or for every position."""

    dK: np.ndarray
    bias: np.ndarray
    dtheta: np.ndarray
    gamma: np.ndarray
    dbeta: np.ndarray


def mount(dtheta: np.ndarray) -> Rotation:
    """R(w) = Rx(w_x) Ry(w_y) Rz(w_z), each passive."""
    dtheta = np.asarray(dtheta)
    return passive("x", dtheta[..., 0]) * passive("y", dtheta[..., 1]) * passive("z", dtheta[..., 2])


def specific_force(alpha: np.ndarray, beta: np.ndarray) -> np.ndarray:
    """(positions, 3): Rx(alpha) Ry(beta) (0, 0, 1)."""
    up = np.tile([0.0, 0.0, 1.0], (len(alpha), 1))
    return passive("x", alpha).apply(passive("y", beta).apply(up))


def readings(alpha: np.ndarray, beta: np.ndarray, true: Instrument, intended: Rotation | None = None) -> np.ndarray:
    """(positions, 3) in g; `intended` is each position's nominal orientation of the mounting (passive)."""
    f = specific_force(alpha, beta + true.dbeta)
    if intended is not None:
        f = intended.apply(f)
    f = mount(true.dtheta).apply(f)
    g21, g31, g32 = true.gamma
    triad = np.array([[1.0, 0.0, 0.0], [g21, 1.0, 0.0], [g31, g32, 1.0]])
    return (1.0 + np.asarray(true.dK)) * (f @ triad.T) + true.bias


def nominal(vector: np.ndarray, alpha: np.ndarray, beta: np.ndarray, setting: np.ndarray) -> np.ndarray:
    """Readings by the vector dK, bias, dtheta, gamma, dbeta_0 ...; `setting` is each position's pitch setting."""
    return readings(alpha, beta, Instrument(vector[0:3], vector[3:6], vector[6:9], vector[9:12], vector[12:][setting]))


def least(residual, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares by MINPACK with difference Jacobians; arguments in units of 1e-3.

    MINPACK stops when the sum of squares no longer falls, at half the digits of the arguments; a few plain
    Gauss-Newton steps with one Jacobian go on from there.

    Returns: the arguments at the minimum, and the inverse of J'J there.
    """
    jacobian = central(residual)
    point = least_squares(residual, start, method="lm", jac=jacobian, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    slope = jacobian(point)
    for _ in range(3):
        point = point - np.linalg.lstsq(slope, residual(point), rcond=None)[0]
    return point, np.linalg.inv(slope.T @ slope)


def scipy_fit(
    measured: np.ndarray, alpha: np.ndarray, beta: np.ndarray, setting: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Unweighted least squares of the nominal chain.

    Returns: the vector, and its covariance for unit noise.
    """
    point, covariance = least(
        lambda scaled: (nominal(scaled * 1e-3, alpha, beta, setting) - measured).ravel() * 1e3,
        np.zeros(12 + int(setting.max()) + 1),
    )
    return point * 1e-3, covariance


def central(function, step: float = 1e-2):
    """Jacobian by central differences; the arguments are in units of 1e-3, so a step is 1e-5 and the error 1e-10."""

    def jacobian(point: np.ndarray) -> np.ndarray:
        units = np.eye(len(point)) * step
        return np.stack([(function(point + unit) - function(point - unit)) / (2 * step) for unit in units], axis=1)

    return jacobian
