"""Allan deviation against allantools and closed forms; the noise model against simulated noise of known size."""

import allantools
import numpy as np
import pytest
from scipy.signal import lfilter

from tumblecal.capture.allan import averaging_factors, overlapping_allan
from tumblecal.capture.noise_model import NoiseModel, fit_noise, markov_allan_variance
from tumblecal.capture.reduce import batch_means_sd


def markov(random: np.random.Generator, n: int, sd: float, time_s: float, rate: float) -> np.ndarray:
    decay = np.exp(-1 / (time_s * rate))
    drive = random.normal(size=n) * sd * np.sqrt(1 - decay**2)
    drive[0] = random.normal() * sd
    return lfilter([1.0], [1.0, -decay], drive)


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


def test_pooling_is_the_weighted_mean_of_variances() -> None:
    random = np.random.default_rng(1)
    first, second = random.normal(size=3000), 2 * random.normal(size=5000)
    factors = np.array([1, 8, 64])
    both = overlapping_allan([first, second], 100.0, factors).deviation ** 2
    alone = [overlapping_allan([d], 100.0, factors).deviation ** 2 for d in (first, second)]
    terms = [len(d) - 2 * factors + 1 for d in (first, second)]
    np.testing.assert_allclose(both, (alone[0] * terms[0] + alone[1] * terms[1]) / (terms[0] + terms[1]))


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
    for factor in (40, 100, 300):
        lag = np.abs(np.subtract.outer(np.arange(2 * factor), np.arange(2 * factor))) / rate
        covariance = np.exp(-lag / time_s)
        weights = np.concatenate([-np.ones(factor), np.ones(factor)]) / factor
        direct = 0.5 * weights @ covariance @ weights
        closed = markov_allan_variance(np.array([factor / rate]), time_s)[0]
        assert closed == pytest.approx(direct, rel=0.002)
    # Short times, where the closed form would lose its digits: 2 x / 3.
    np.testing.assert_allclose(markov_allan_variance(np.array([1e-6, 1e-5]), 1.0), [2e-6 / 3, 2e-5 / 3], rtol=1e-4)


def test_noise_model_finds_white_and_markov_noise() -> None:
    random = np.random.default_rng(4)
    rate, n = 50.0, 30_000
    dwells = [random.normal(size=n) * 50e-6 * np.sqrt(rate) + markov(random, n, 100e-6, 10.0, rate) for _ in range(12)]
    model = fit_noise(overlapping_allan(dwells, rate))
    assert model.white_g_per_rthz == pytest.approx(50e-6, rel=0.03)
    assert model.markov_sd_g == pytest.approx(100e-6, rel=0.15)
    assert model.markov_time_s == pytest.approx(10.0, rel=0.35)
    assert model.reduced_chi2 < 3


def test_noise_model_finds_a_random_walk() -> None:
    random = np.random.default_rng(5)
    rate, n = 50.0, 20_000
    dwells = [
        random.normal(size=n) * 40e-6 * np.sqrt(rate) + np.cumsum(random.normal(size=n)) * 20e-6 / np.sqrt(rate)
        for _ in range(10)
    ]
    model = fit_noise(overlapping_allan(dwells, rate))
    assert model.white_g_per_rthz == pytest.approx(40e-6, rel=0.05)
    variance = model.allan_variance(np.array([100.0]))[0]
    assert variance == pytest.approx((40e-6) ** 2 / 100 + (20e-6) ** 2 * 100 / 3, rel=0.2)


def test_white_noise_alone_stays_white() -> None:
    random = np.random.default_rng(6)
    model = fit_noise(overlapping_allan([random.normal(size=20_000) * 1e-3 for _ in range(8)], 100.0))
    assert model.white_g_per_rthz == pytest.approx(1e-4, rel=0.02)
    assert model.markov_sd_g == 0.0
    assert np.sqrt(model.mean_variance(200.0)) == pytest.approx(1e-4 / np.sqrt(200.0), rel=0.15)


@pytest.mark.parametrize("time_s", [0.5, 5.0])
def test_sd_of_the_mean_of_coloured_noise_is_honest(time_s: float) -> None:
    """Means over many dwells scatter as the model says, far more than sd / sqrt(n) says."""
    random = np.random.default_rng(7)
    rate, n = 50.0, 5000
    dwells = [
        random.normal(size=n) * 20e-6 * np.sqrt(rate) + markov(random, n, 200e-6, time_s, rate) for _ in range(150)
    ]
    model = fit_noise(overlapping_allan(dwells[:30], rate))
    predicted = np.sqrt(model.mean_variance(n / rate))
    actual = np.std([d.mean() for d in dwells])
    # The sd of 150 means is known to 6 %, the model's to about 10 %.
    assert predicted == pytest.approx(actual, rel=0.25)
    naive = np.mean([d.std() / np.sqrt(n) for d in dwells])
    assert naive < 0.5 * actual
    batches = np.sqrt(np.mean([batch_means_sd(np.repeat(d[:, None], 3, 1))[0] ** 2 for d in dwells]))
    assert batches == pytest.approx(actual, rel=0.35)


def test_short_data_still_give_a_model() -> None:
    model = fit_noise(overlapping_allan([np.array([1.0, 2.0, 1.5, 0.5])], 10.0))
    assert isinstance(model, NoiseModel) and model.white_g_per_rthz > 0
