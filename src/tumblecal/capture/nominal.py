"""What an ideal instrument shows at a position; the exact chain with its effects is not needed for that."""

import numpy as np
from numpy.typing import NDArray


def nominal_force(alpha_deg: float, beta_deg: float, mount: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """Specific force in units of local gravity, f = (-sin beta, cos beta sin alpha, cos beta cos alpha), then the mount.

    **Arguments:**

    - `alpha_deg`, `beta_deg`: spindle and pitch angle.
    - `mount`: nominal rotation from the spindle's axes to the sensor's, shape (3, 3); None for identity.

    **Returns:** shape (3,).
    """
    alpha, beta = np.radians([alpha_deg, beta_deg])
    force = np.array([-np.sin(beta), np.cos(beta) * np.sin(alpha), np.cos(beta) * np.cos(alpha)])
    return force if mount is None else mount @ force


def angle_between_deg(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Angle between two directions, precise also when they are nearly the same."""
    cross = np.linalg.norm(np.cross(first, second))
    return float(np.degrees(np.arctan2(cross, np.dot(first, second))))
