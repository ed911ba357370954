"""Passive rotations of vectors of three components, with numpy or JAX, according to the type of the components.

A vector is a tuple of its x, y and z components, each an array over positions (or a scalar). Rotations written out
by component need no small matrix products, which XLA would loop over one by one; a batch then runs at the speed of
elementwise arithmetic. The matrices are coordinate rotations of column vectors.
"""

from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float


Components: TypeAlias = tuple[Any, Any, Any]


def rotate_x(angle: Any, f: Components) -> Components:
    """`Rx(angle) f` with Rx = [1 0 0; 0 c s; 0 -s c]; angle in rad."""
    x, y, z = f
    c, s = _cosine_and_sine(angle, x)
    return x, c * y + s * z, c * z - s * y


def rotate_y(angle: Any, f: Components) -> Components:
    """`Ry(angle) f` with Ry = [c 0 -s; 0 1 0; s 0 c]; angle in rad."""
    x, y, z = f
    c, s = _cosine_and_sine(angle, x)
    return c * x - s * z, y, s * x + c * z


def rotate_z(angle: Any, f: Components) -> Components:
    """`Rz(angle) f` with Rz = [c s 0; -s c 0; 0 0 1]; angle in rad."""
    x, y, z = f
    c, s = _cosine_and_sine(angle, x)
    return c * x + s * y, c * y - s * x, z


def _cosine_and_sine(angle: Any, component: Any) -> tuple[Any, Any]:
    namespace = component.__array_namespace__()
    return namespace.cos(angle), namespace.sin(angle)


def rotation_matrix(angles: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """`R(w) = Rx(w_x) Ry(w_y) Rz(w_z)` as a numpy matrix; angles in rad."""
    x, y, z = np.eye(3)
    return np.stack(rotate_x(angles[0], rotate_y(angles[1], rotate_z(angles[2], (x, y, z)))))


def rotation_angles(matrix: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3"]:
    """The angles w with `rotation_matrix(w) == matrix`, |w_y| <= pi/2; the inverse of `rotation_matrix`."""
    # First row of Rx Ry Rz: (cy cz, cy sz, -sy); last column: (-sy, sx cy, cx cy).
    return np.array(
        [
            np.arctan2(matrix[1, 2], matrix[2, 2]),
            np.arctan2(-matrix[0, 2], np.hypot(matrix[0, 0], matrix[0, 1])),
            np.arctan2(matrix[0, 1], matrix[0, 0]),
        ]
    )


def gravity_in_head(
    alpha: Float[np.ndarray, "*n"] | float, beta: Float[np.ndarray, "*n"] | float
) -> Float[np.ndarray, "*n 3"]:
    """Specific force in the frame of the spindle, g: `Rx(alpha) Ry(beta) (0, 0, 1)`; angles in rad."""
    across = np.cos(beta)
    return np.stack([-np.sin(beta), across * np.sin(alpha), across * np.cos(alpha)], axis=-1)


def angle_between_deg(first: Float[np.ndarray, "3"], second: Float[np.ndarray, "3"]) -> float:
    """Angle between two directions, deg; precise also for nearly equal directions."""
    cross = np.linalg.norm(np.cross(first, second))
    return float(np.degrees(np.arctan2(cross, np.dot(first, second))))
