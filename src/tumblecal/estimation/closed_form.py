"""The affine closed form: for given dbeta the nominal chain is `A = M v + bias`, and M splits exactly.

`M = diag(1 + dK) T R` is a lower triangular matrix with positive diagonal times a rotation (an LQ factorisation):
scale, non-orthogonality and mount at any angle. dbeta is found by variable projection
(Golub and Pereyra 1973, with Kaufman's 1975 Jacobian), independently of the chain's own derivative. Plain numpy.
"""

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Chain, followings_of
from tumblecal.chain.nominal import Mount
from tumblecal.data import PositionSet
from tumblecal.ground.angle_settings import setting_index
from tumblecal.ground.frames import gravity_in_head, rotation_angles


MOST_STEPS = 50


def applies(chain: Chain) -> bool:
    """Whether `chain` is the nominal one with a single mount, sensor and set of pitch settings, all free."""
    mounts = [link for link in chain.links if isinstance(link, Mount)]
    names = [leaf.name for leaf in chain.free]
    shared = all(leaf.by is None for leaf in chain.free if leaf.name != "dbeta")
    pitch = all(leaf.by == "pitch" for leaf in chain.free if leaf.name == "dbeta")
    plain = all(link.nominal is None for link in mounts)
    nominal = names == ["dK", "bias", "dtheta", "gamma", "dbeta"] and not followings_of(chain)
    return nominal and shared and pitch and plain and len(mounts) == 1


def estimate(data: PositionSet) -> Float[np.ndarray, " free"]:
    """The nominal parameters (dK, bias, dtheta, gamma, dbeta) by variable projection, with equal weights of all readings.

    **Arguments:**

    - `data`: positions of one mount at two or more pitch settings.

    **Returns:** the parameter vector in the chain's order, base units.
    """
    pitch = setting_index(data.beta, held=True)
    dbeta = np.zeros(int(pitch.max()) + 1)
    for _ in range(MOST_STEPS):
        basis, slope = _basis(data, dbeta[pitch])
        coefficients = np.linalg.lstsq(basis, data.readings, rcond=None)[0]
        residual = data.readings - basis @ coefficients
        inverse = np.linalg.pinv(basis)
        moved = [(pitch == k)[:, None] * slope @ coefficients[:3] for k in range(len(dbeta))]
        jacobian = np.stack([(rows - basis @ (inverse @ rows)).ravel() for rows in moved], axis=1)
        step = np.linalg.lstsq(jacobian, residual.ravel(), rcond=None)[0]
        dbeta += step
        if np.max(np.abs(step)) < 1e-15:
            break
    basis, _ = _basis(data, dbeta[pitch])
    coefficients = np.linalg.lstsq(basis, data.readings, rcond=None)[0]
    return np.concatenate([*split(coefficients[:3].T, coefficients[3]), dbeta])


def _basis(data: PositionSet, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Regressors `[v, 1]` at pitch errors `error`, and the derivative of v by them."""
    v = gravity_in_head(data.alpha, data.beta + error)
    slope = gravity_in_head(data.alpha, data.beta + error + np.pi / 2)
    return np.hstack([v, np.ones((len(v), 1))]), slope


def split(matrix: Float[np.ndarray, "3 3"], bias: Float[np.ndarray, "3"]) -> tuple[np.ndarray, ...]:
    """The factors of `M = diag(1 + dK) T R`.

    **Returns:** dK, bias, dtheta, gamma (21, 31, 32).
    """
    orthogonal, upper = np.linalg.qr(matrix.T)
    signs = np.sign(np.diag(upper))
    lower, rotation = (upper.T * signs), (orthogonal * signs).T
    diagonal = np.diag(lower)
    # Row i of diag(1 + dK) T is (1 + dK_i) times row i of T, whose diagonal is one.
    triad = lower / diagonal[:, None]
    gamma = np.array([triad[1, 0], triad[2, 0], triad[2, 1]])
    return diagonal - 1.0, bias, rotation_angles(rotation), gamma
