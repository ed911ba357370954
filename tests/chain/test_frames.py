"""Passive rotations against scipy, and their inverses."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import independent
from tumblecal.ground import frames


ANGLE = st.floats(-10.0, 10.0)


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
