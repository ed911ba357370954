"""Differences of covariances stay covariances; terms of many kinds at once are those of the equation."""

import numpy as np

from tumblecal.data.calibration_terms import Term, contributions


def test_all_terms_at_once():
    inputs, degc = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.5], [0.3, -0.4, 0.5]]), np.array([10.0, 25.0])
    x, y, z = inputs.T
    terms = {
        Term("x", 7.0): np.ones((2, 3)),
        Term("y", 7.0, (1, 1, 0), "abs"): np.abs(x * y)[None].repeat(2, 0),
        Term("z", 7.0, (0, 3, 0), "sign"): np.sign(y)[None].repeat(2, 0),
        Term("x", 7.0, (2, 0, 1), degc_power=2, reference_degc=20.0): np.outer((degc - 20.0) ** 2, x**2 * z),
    }
    found = contributions([*terms], inputs, degc)
    for term, one, expected in zip(terms, found, terms.values(), strict=True):
        np.testing.assert_allclose(one[:, :, "xyz".index(term.axis)], expected, rtol=1e-14, atol=0.0)
        np.testing.assert_allclose(one.sum(axis=2), expected, rtol=1e-14, atol=0.0)
    # Without a temperature, one degree from the reference.
    np.testing.assert_allclose(contributions([*terms], inputs, None)[3, 0, :, 0], x**2 * z, rtol=1e-14, atol=0.0)
    assert contributions([], inputs, None).size == 0
