"""Units as a linear mixed model: normal equations against dense covariance matrices of all readings."""

import numpy as np
import pytest
from scipy.linalg import block_diag

from tumblecal.diagnosis.units.mixed_model import NormalEquations


ROWS, COLUMNS, UNITS = 12, 3, 5


@pytest.fixture(scope="module")
def measured():
    """Designs (units, rows, columns) and readings of unit noise, whose coefficients differ by 2."""
    rng = np.random.default_rng(4)
    designs = rng.normal(size=(UNITS, ROWS, COLUMNS))
    amounts = np.array([1.0, -2.0, 0.5]) + 2.0 * rng.normal(size=(UNITS, COLUMNS))
    return designs, np.matvec(designs, amounts) + rng.normal(size=(UNITS, ROWS))


def log_density(z, covariance) -> float:
    """Of normal readings, but for the constant."""
    return -0.5 * float(np.linalg.slogdet(covariance)[1] + z @ np.linalg.solve(covariance, z))


def equations(designs, readings) -> NormalEquations:
    return NormalEquations(designs.mT @ designs, np.vecmat(readings, designs), np.zeros(len(designs)))


@pytest.mark.parametrize("columns", [(1,), (0, 2), (0, 1, 2)])
def test_random_effects_are_integrated_out(measured, columns):
    designs, readings = measured
    tau, random = 1.7, designs[:, :, list(columns)]
    marginal = equations(designs, readings).marginal(columns, tau)
    deviations = equations(designs, readings).deviations(columns, tau)
    for unit, (x, b, z) in enumerate(zip(designs, random, readings, strict=True)):
        covariance = np.eye(ROWS) + tau**2 * b @ b.T
        dense = log_density(z, covariance) - log_density(z, np.eye(ROWS))
        assert np.asarray(marginal.log_evidence)[unit] == pytest.approx(dense, rel=1e-9)
        np.testing.assert_allclose(marginal.gram[unit], x.T @ np.linalg.solve(covariance, x), atol=1e-10)
        np.testing.assert_allclose(marginal.towards[unit], x.T @ np.linalg.solve(covariance, z), atol=1e-10)
        predicted = tau**2 * b.T @ np.linalg.solve(covariance, z)
        np.testing.assert_allclose(deviations[unit, list(columns)], predicted, atol=1e-10)


def test_likelihoods_of_the_spread_are_those_of_all_readings(measured):
    """About zero by the density of all readings; restricted by that of contrasts without the mean. One constant apart."""
    designs, readings = measured
    taus, whole = np.array([0.0, 0.5, 2.0, 20.0]), equations(designs, readings)
    stacked, z = np.concatenate(designs), readings.ravel()
    contrasts = np.linalg.qr(stacked, mode="complete")[0][:, COLUMNS:]
    dense = []
    for tau in taus:
        covariance = np.eye(len(z)) + tau**2 * np.asarray(block_diag(*designs @ designs.mT))
        of_contrasts = log_density(contrasts.T @ z, contrasts.T @ covariance @ contrasts)
        dense.append([log_density(z, covariance), of_contrasts])
    at = whole.marginal(range(COLUMNS), taus[:, None, None, None]).total
    found = np.stack([at.log_evidence, at.restricted], axis=1)
    np.testing.assert_allclose(np.diff(found, axis=0), np.diff(dense, axis=0), rtol=1e-8)


def test_a_unit_without_information_determines_nothing(measured):
    """Its information is rounding, of either sign: a root of it was a warning."""
    gram, towards, none = equations(*measured)
    gram[1], towards[1], gram[2], towards[2] = -1e-14, 1e-12, 1e-14, 1e-12
    estimates = NormalEquations(gram, towards, none).solved()
    assert np.all(estimates[1:3] == 0.0)
    np.testing.assert_allclose(estimates[0], np.linalg.solve(gram[0], towards[0]))
