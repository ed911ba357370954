"""Processes by their size: one residual vector by a tridiagonal system, many by principal components."""

import numpy as np

from tumblecal.diagnosis.lack_of_fit.components import SIZES, Components, of_one_vector


def test_one_residual_vector_and_many_are_weighed_as_by_the_whole_covariance():
    """Processes of 5 and of 9 signals, one of them without a signal; the second kind has two equal ones."""
    rng = np.random.default_rng(3)
    narrow, wide, z = rng.normal(size=(4, 20, 5)), rng.normal(size=(3, 20, 9)), rng.normal(size=(7, 20))
    narrow[1, :, 2], wide[:, :, 8] = 0.0, wide[:, :, 0]
    products = [np.swapaxes(own, 1, 2) @ own for own in (narrow, wide)]
    for vector in z:
        made = of_one_vector(products, [vector @ own for own in (narrow, wide)])
        row = 0
        for signals, own in zip((narrow, wide), products, strict=True):
            components = Components.of(own)
            many = components.of_vectors(np.swapaxes(signals @ components.normalised, 1, 2) @ z.T)
            for k, seen in enumerate(np.trace(own, axis1=1, axis2=2)):
                scales = SIZES**2 / seen
                whole = np.eye(20) + scales[:, None, None] * (signals[k] @ signals[k].T)
                explained = (
                    vector @ vector
                    - np.linalg.solve(whole, np.tile(vector[:, None], (len(scales), 1, 1)))[:, :, 0] @ vector
                )
                np.testing.assert_allclose(made.explained[row, :, 0], explained, rtol=1e-7)
                np.testing.assert_allclose(made.half_log_dets[row], 0.5 * np.linalg.slogdet(whole)[1], rtol=1e-9)
                drawn = np.flatnonzero(np.all(z == vector, axis=1))
                np.testing.assert_allclose(many.explained[k][:, drawn], made.explained[row], rtol=1e-7)
                row += 1
            np.testing.assert_allclose(many.half_log_dets, made.half_log_dets[row - len(own) : row], rtol=1e-9)
