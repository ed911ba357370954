"""Allan deviation against allantools and closed forms."""

import allantools
import numpy as np
import pytest

from tumblecal.noise import GaussMarkov
from tumblecal.noise.allan import averaging_factors, overlapping_allan


@pytest.mark.parametrize("kind", ["white", "walk", "offset"])
def test_agrees_with_allantools(kind: str) -> None:
    random = np.random.default_rng(3)
    data = random.normal(size=20_000)
    data = {"white": data, "walk": np.cumsum(data) * 0.01, "offset": data * 1e-4 + 1.0}[kind]
    factors = averaging_factors(len(data))
    found = overlapping_allan([data], 125.0, factors)
    taus, deviation, _, _ = allantools.oadev(data, rate=125.0, data_type="freq", taus=factors / 125.0)
    np.testing.assert_allclose(found.tau_s, taus, rtol=1e-12)
    np.testing.assert_allclose(found.deviation, deviation, rtol=1e-9)


def test_confidence_band_covers_the_truth() -> None:
    """White noise: the 68 % band holds the true deviation in about 68 % of 300 records, at every averaging time."""
    random = np.random.default_rng(2)
    factors = np.array([1, 4, 16, 64, 256])
    inside = np.zeros(len(factors))
    for _ in range(300):
        found = overlapping_allan([random.normal(size=1024)], 1.0, factors)
        truth = 1 / np.sqrt(factors)
        inside += (found.low < truth) & (truth < found.high)
    # Binomial sd 0.027; the degrees of freedom are an approximation.
    np.testing.assert_allclose(inside / 300, 0.68, atol=0.1)


def test_markov_closed_form() -> None:
    """Against the autocovariance summed directly: the Allan variance of averages of a Gauss-Markov process."""
    time_s, rate = 2.0, 50.0
    part = GaussMarkov(np.ones(3), time_s)
    for factor in (40, 100, 300):
        lag = np.abs(np.subtract.outer(np.arange(2 * factor), np.arange(2 * factor))) / rate
        covariance = np.exp(-lag / time_s)
        weights = np.concatenate([-np.ones(factor), np.ones(factor)]) / factor
        direct = 0.5 * weights @ covariance @ weights
        assert part.allan_variance(np.array([factor / rate]))[0, 0] == pytest.approx(direct, rel=0.002)
    # Short times, where the closed form would lose its digits: 2 x / 3.
    short = GaussMarkov(np.ones(3), 1.0).allan_variance(np.array([1e-6, 1e-5]))
    np.testing.assert_allclose(short[:, 0], [2e-6 / 3, 2e-5 / 3], rtol=1e-4)
