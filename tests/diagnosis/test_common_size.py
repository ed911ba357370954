"""Coefficients of one effect that the data hardly determine are taken to be of the size of the others."""

from types import SimpleNamespace

import numpy as np

from tumblecal.diagnosis.findings.common_size import prior_rows, updated_by


def updated(sizes: np.ndarray, covariance: np.ndarray, first: int) -> tuple[np.ndarray, np.ndarray]:
    """The update by the prior of an effect whose coefficients are the entries from `first` on."""
    effect = SimpleNamespace(slot=SimpleNamespace(columns=tuple(range(first, len(sizes)))))
    return updated_by(prior_rows([effect], np.eye(len(sizes)), sizes, covariance), sizes, covariance)


def test_what_is_determined_stays_and_what_is_not_gets_its_size():
    # A bias (first) that moves with the third coefficient, as where a setting shows little of it.
    spread = np.array(
        [[0.1, 0.0, 0.0, 0.9 * 19.0], [0.0, 0.13, 0.0, 0.0], [0.0, 0.0, 0.22, 0.0], [0.0, 0.0, 0.0, 19.0]]
    )
    covariance = spread @ spread.T
    values, after = updated(np.array([30.0, -1.06, 1.11, 33.0]), covariance, 1)
    sd = np.sqrt(np.diag(after))
    np.testing.assert_allclose(values[1:3], [-1.06, 1.11], rtol=0.05)
    assert abs(values[3]) < 3.0 < 2 * sd[3] < 20.0
    # The bias follows: 0.9 of the coefficient is taken back.
    assert abs(values[0] - 0.3) < 3.0
    # Where all are determined nothing changes to speak of.
    values, after = updated(np.array([2.0, -1.5, 1.2]), np.eye(3) * 0.05**2, 0)
    np.testing.assert_allclose(values, [2.0, -1.5, 1.2], atol=0.05 * 0.05)
    np.testing.assert_allclose(np.diag(after), 0.05**2, rtol=0.01)


def test_an_effect_of_one_coefficient_is_not_touched():
    values, after = updated(np.array([1.0, 40.0]), np.diag([0.1, 15.0]) ** 2, 1)
    np.testing.assert_array_equal(values, [1.0, 40.0])
    np.testing.assert_allclose(after, np.diag([0.1, 15.0]) ** 2)


def test_intervals_hold_the_truth_whatever_the_size():
    rng, held = np.random.default_rng(7), []
    noise = np.array([0.2, 0.2, 0.3, 15.0])
    for _ in range(1500):
        width = np.exp(rng.uniform(np.log(0.5), np.log(20.0)))
        truth = width * rng.normal(size=4)
        sds = noise * width
        values, after = updated(truth + sds * rng.normal(size=4), np.diag(sds**2), 0)
        held.append(np.abs(values - truth) < 1.96 * np.sqrt(np.diag(after)))
    shares = np.mean(held, axis=0)
    assert np.all(shares[:3] > 0.93) and np.all(shares[3] > 0.93), shares
