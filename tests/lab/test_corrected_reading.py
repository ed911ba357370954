"""Differences of covariances stay covariances."""

import numpy as np

from tumblecal.lab.corrected_reading import without_negative


def test_a_difference_has_no_negative_variance():
    rng = np.random.default_rng(2)
    root = rng.normal(size=(5, 5)) * np.geomspace(1e-6, 1.0, 5)[:, None]
    whole, part = root @ root.T, 1.3 * np.outer(root[:, 0], root[:, 0])
    found = without_negative(whole - part, whole)
    sd = np.sqrt(np.diag(whole))
    assert np.linalg.eigvalsh(found / np.outer(sd, sd)).min() > -1e-12
    # A difference that is one stays as it is.
    np.testing.assert_allclose(without_negative(whole, whole), whole, rtol=1e-9, atol=1e-18)
