"""Harmonic least squares against direct sums, the written-out equations and a plain regression."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rigs import measured, random_vector

from tumblecal import InputError
from tumblecal.estimation import harmonic, problem_of


SEEDS = st.integers(0, 2**32 - 1)


def table(vector, beta):
    """DESIGN section 2's table, written out: a0, s1, c1 of the three axes for each pitch setting."""
    dKx, dKy, dKz, bx, by, bz, thx, thy, thz, g21, g31, g32, *dbeta = vector
    rows = []
    for angle, db in zip(beta, dbeta, strict=True):
        sinb, cosb = np.sin(angle), np.cos(angle)
        rows += [bx - sinb - cosb * db - sinb * dKx, cosb * thz, -cosb * thy]
        rows += [by + sinb * (thz - g21), cosb * (1 + dKy) - sinb * db, cosb * thx]
        rows += [bz - sinb * (thy + g31), cosb * (g32 - thx), cosb * (1 + dKz) - sinb * db]
    return np.array(rows)


@given(SEEDS)
def test_other_angles_are_a_regression(seed):
    """Random spindle angles with repeats, sd columns: numpy's weighted lstsq over each pitch setting and axis."""
    rng = np.random.default_rng(seed)
    beta = np.repeat([0.0, 45.0, 90.0], 8)
    alpha = rng.uniform(-180, 180, 24)
    alpha[3] = alpha[2]
    data = replace(measured(random_vector(seed), alpha, beta, sd=1e-3, seed=seed), sd=rng.uniform(1e-4, 1e-3, (24, 3)))
    harmonics = harmonic.analyse(problem_of(data))
    got = (harmonics.z + harmonics.ideal).reshape(3, 3, 3)
    for k in range(3):
        rows = slice(8 * k, 8 * k + 8)
        angle = data.alpha[rows]
        regressors = np.stack([np.ones(8), np.sin(angle), np.cos(angle)], axis=1)
        for axis in range(3):
            weight = 1 / data.sd[rows, axis]
            expected = np.linalg.lstsq(regressors * weight[:, None], data.readings[rows, axis] * weight, rcond=None)[0]
            np.testing.assert_allclose(got[k, axis], expected, rtol=0, atol=1e-10)


def test_estimate_is_the_weighted_regression_on_the_table(table1):
    """Means have variance s^2/n, sines and cosines 2 s^2/n."""
    result = harmonic.fit(problem_of(table1))
    beta = np.radians([0.0, 45.0, 90.0])
    ideal = table(np.zeros(15), beta)
    columns = np.stack([table(unit, beta) - ideal for unit in np.eye(15)], axis=1)
    harmonics = harmonic.analyse(problem_of(table1))
    weight = np.tile([np.sqrt(8), 2.0, 2.0], 9)
    z = harmonics.z * weight
    expected = np.linalg.lstsq(columns * weight[:, None], z, rcond=None)[0]
    np.testing.assert_allclose(result.values, expected, rtol=0, atol=1e-14)
    covariance = np.linalg.inv((columns * weight[:, None]).T @ (columns * weight[:, None]))
    np.testing.assert_allclose(result.covariance, covariance * result.sigma**2, rtol=1e-9, atol=1e-22)


def test_what_the_equations_do_not_fit_is_refused(table1):
    two = table1.chosen([0, 1, 8, 9, 10, 16, 17, 18])
    with pytest.raises(InputError, match=r"needs three spindle angles.*0 deg has 2"):
        harmonic.fit(problem_of(two))
    with pytest.raises(InputError, match="apply to one mounting"):
        harmonic.fit(problem_of(replace(table1, mount=("A",) * 12 + ("B",) * 12)))
