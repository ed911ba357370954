"""Passive rotations against scipy, and their inverses."""

import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import independent
from independent import passive
from tumblecal.ground import frames


ANGLE = st.floats(-10.0, 10.0)


@given(ANGLE, st.integers(0, 2**32 - 1))
def test_rotations_are_scipys_passive_ones(angle, seed):
    vectors = np.random.default_rng(seed).normal(size=(5, 3))
    angles = jnp.full(5, angle)
    for axis, rotate in zip("xyz", (frames.rotate_x, frames.rotate_y, frames.rotate_z), strict=True):
        ours = jnp.stack(rotate(angles, tuple(jnp.asarray(vectors.T))), axis=-1)
        np.testing.assert_allclose(ours, passive(axis, np.full(5, angle)).apply(vectors), atol=1e-14)


@given(st.tuples(ANGLE, st.floats(-1.57, 1.57), ANGLE))
def test_matrix_and_angles_are_each_others_inverse(angles):
    matrix = frames.rotation_matrix(np.array(angles))
    np.testing.assert_allclose(matrix, independent.mount(np.array(angles)).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-15)
    back = frames.rotation_angles(matrix)
    np.testing.assert_allclose(frames.rotation_matrix(back), matrix, atol=1e-14)
    turns = (back - np.array(angles)) / (2 * np.pi)
    if abs(angles[1]) < 1.5:  # nearer to the singularity x and z share their angle
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-12)


def test_signs_are_the_designs():
    """Rx(a) = [1 0 0; 0 c s; 0 -s c] and its sisters, at 30 degrees, written out."""
    c, s = np.sqrt(3) / 2, 0.5
    third = np.pi / 6
    np.testing.assert_allclose(frames.rotation_matrix(np.array([third, 0, 0])), [[1, 0, 0], [0, c, s], [0, -s, c]])
    np.testing.assert_allclose(frames.rotation_matrix(np.array([0, third, 0])), [[c, 0, -s], [0, 1, 0], [s, 0, c]])
    np.testing.assert_allclose(frames.rotation_matrix(np.array([0, 0, third])), [[c, s, 0], [-s, c, 0], [0, 0, 1]])
