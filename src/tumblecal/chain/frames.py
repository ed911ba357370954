"""Passive rotations of vectors kept as three components.

A vector is a tuple of its x, y and z components, each an array over positions (or a scalar). Rotations written out
by component need no small matrix products, which XLA would loop over one by one; a batch then runs at the speed of
elementwise arithmetic. The matrices are those of DESIGN section 1 (coordinate rotations, column vectors).
"""

from typing import TypeAlias

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


Component: TypeAlias = Float[Array | np.ndarray | np.floating, "..."]
Vector: TypeAlias = tuple[Component, Component, Component]


def rotate_x(angle: Component, f: Vector) -> Vector:
    """`Rx(angle) f` with Rx = [1 0 0; 0 c s; 0 -s c]; angle in rad."""
    x, y, z = f
    c, s = jnp.cos(angle), jnp.sin(angle)
    return x, c * y + s * z, c * z - s * y


def rotate_y(angle: Component, f: Vector) -> Vector:
    """`Ry(angle) f` with Ry = [c 0 -s; 0 1 0; s 0 c]; angle in rad."""
    x, y, z = f
    c, s = jnp.cos(angle), jnp.sin(angle)
    return c * x - s * z, y, s * x + c * z


def rotate_z(angle: Component, f: Vector) -> Vector:
    """`Rz(angle) f` with Rz = [c s 0; -s c 0; 0 0 1]; angle in rad."""
    x, y, z = f
    c, s = jnp.cos(angle), jnp.sin(angle)
    return c * x + s * y, c * y - s * x, z


def rotation_matrix(angles: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """`R(w) = Rx(w_x) Ry(w_y) Rz(w_z)` as a numpy matrix; angles in rad."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles), np.sin(angles)
    about_x = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    about_y = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
    about_z = np.array([[cz, sz, 0], [-sz, cz, 0], [0, 0, 1]])
    return about_x @ about_y @ about_z


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


def gravity_in_head(alpha: Float[np.ndarray, " n"], beta: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """Specific force in the spindle's frame, g: `Rx(alpha) Ry(beta) (0, 0, 1)`; angles in rad."""
    across = np.cos(beta)
    return np.stack([-np.sin(beta), across * np.sin(alpha), across * np.cos(alpha)], axis=-1)
