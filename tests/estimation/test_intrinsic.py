"""What no mounting changes: against the Gram matrix of a general triad, under any rotation."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from rigs import PAPER_ALPHA, PAPER_BETA, measured, positions, random_vector
from scipy.spatial.transform import Rotation

import independent
from tumblecal.estimation import exact, problem_of
from tumblecal.estimation.intrinsic import NAMES, intrinsic, matrix_and_bias


def general(seed):
    """A triad with all nine errors, and its scale factors, biases and axis angles straight from its rows."""
    rng = np.random.default_rng(seed)
    matrix = np.eye(3) + rng.uniform(-0.03, 0.03, (3, 3))
    bias = rng.uniform(-0.03, 0.03, 3)
    lengths = np.linalg.norm(matrix, axis=1)
    rows = matrix / lengths[:, None]
    angles = [np.arccos(rows[i] @ rows[j]) - np.pi / 2 for i, j in ((0, 1), (0, 2), (1, 2))]
    return matrix, bias, np.concatenate([lengths - 1, bias, angles])


@settings(max_examples=8)
@given(st.integers(0, 2**32 - 1))
def test_any_rotation_leaves_them_unchanged(seed):
    matrix, bias, expected = general(seed)
    v = independent.specific_force(np.radians(PAPER_ALPHA), np.radians(PAPER_BETA))
    for rotation in (Rotation.identity(), Rotation.random(rng=seed)):
        data = positions(PAPER_ALPHA, PAPER_BETA, rotation.apply(v) @ matrix.T + bias)
        own = intrinsic(exact.fit(problem_of(data, noise_sd=1e-4)))
        assert own.names == NAMES
        np.testing.assert_allclose(own.values, expected, rtol=0, atol=1e-9)


def test_covariances_are_those_of_simulated_calibrations():
    """The delta method against the scatter of 120 fits; 5 sd of a variance's own scatter."""
    truth = random_vector(3)
    invariants, corrections = [], []
    for seed in range(120):
        data = measured(truth, sd=2e-4, seed=seed)
        result = exact.fit(problem_of(data, noise_sd=2e-4))
        invariants.append(intrinsic(result).values)
        matrix, bias, _ = matrix_and_bias(result)
        corrections.append(np.concatenate([matrix.ravel(), bias]))
    tolerance = 5 * np.sqrt(2 / 120)
    stated = np.diag(intrinsic(result).covariance)
    np.testing.assert_allclose(np.var(invariants, axis=0), stated, rtol=tolerance)
    stated = np.diag(matrix_and_bias(result)[2])
    assert np.all(stated[[1, 2, 5]] < 1e-30)  # entries above the diagonal are zero by definition
    seen = stated > 1e-30
    np.testing.assert_allclose(np.var(corrections, axis=0)[seen], stated[seen], rtol=tolerance)
