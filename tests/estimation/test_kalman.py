"""The Kalman filter against batch formulas."""

import numpy as np
import pytest
from rigs import measured, random_vector

from tumblecal.estimation import harmonic, kalman, problem_of
from tumblecal.estimation.kalman import DIFFUSE, Prior


NOISE = 1.5e-4


@pytest.fixture(scope="module")
def sets():
    """200 data sets of harmonics of the linear model itself, with their H and R; and the true parameters."""
    harmonics = harmonic.analyse(problem_of(measured(np.zeros(15))))
    noise = harmonics.covariance * NOISE**2
    truth = random_vector(1, 15, 2e-3)
    rng = np.random.default_rng(7)
    z = harmonics.design @ truth + rng.multivariate_normal(np.zeros(27), noise, 200)
    return z, harmonics.design, noise, truth


def batch(z, design, noise, prior):
    """Posterior mean and covariance of a constant state by the information formula."""
    weight = np.linalg.inv(noise)
    information = np.eye(15) / prior.sd**2 + len(z) * design.T @ weight @ design
    return np.linalg.solve(information, design.T @ weight @ z.sum(axis=0)), np.linalg.inv(information)


@pytest.mark.parametrize("prior", [Prior(3e-4), Prior(1e-2), DIFFUSE])
def test_filter_is_the_batch_posterior(sets, prior):
    z, design, noise, _ = sets
    history, covariance = kalman.run(z, design, noise, prior)
    for step in (1, 7, 200):
        mean, spread = batch(z[:step], design, noise, prior)
        sd = np.sqrt(np.diag(spread))
        np.testing.assert_allclose((history.values[step - 1] - mean) / sd, 0, atol=1e-4)
        np.testing.assert_allclose(history.sd[step - 1], sd, rtol=1e-4)
    np.testing.assert_allclose(covariance / np.outer(sd, sd), spread / np.outer(sd, sd), atol=1e-4)
