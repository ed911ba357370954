"""Noise models against sums over samples, simulated records and the paper's figures."""

import numpy as np
import pytest

from tumblecal.noise import Dwells, Flicker, GaussMarkov, Noise, Quantisation, RandomWalk, White, regular_dwells
from tumblecal.noise.allan import overlapping_allan
from tumblecal.noise.allan_fit import from_figures, from_record
from tumblecal.noise.sampling import record


ONE = np.array([1.0, 2.0, 0.5])


def summed_covariance(kernel, dwells: Dwells) -> np.ndarray:
    """Covariance of means by the double sum over all samples."""
    times = (dwells.start_s[:, None] + np.arange(dwells.samples) * dwells.period_s).ravel()
    count = len(dwells.start_s)
    table = kernel(times[:, None], times[None, :])
    return table.reshape(count, dwells.samples, count, dwells.samples).mean(axis=(1, 3))


@pytest.mark.parametrize("time_s", [0.03, 1.0, 50.0, 1e4, 1e9])
def test_dwell_means_of_exponential_noise_are_the_double_sum(time_s):
    dwells = regular_dwells(4, dwell_s=3.0, move_s=0.7, rate_hz=20.0)
    expected = summed_covariance(lambda s, t: np.exp(-np.abs(s - t) / time_s), dwells)
    found = GaussMarkov(ONE, time_s).mean_covariance(dwells)
    np.testing.assert_allclose(found, ONE[:, None, None] ** 2 * expected, rtol=1e-9, atol=1e-300)


@pytest.mark.parametrize("part", [White(ONE), GaussMarkov(ONE, 2.0), RandomWalk(ONE)])
def test_dwells_of_different_lengths_are_the_double_sum(part):
    """Also where they are not in the order of time."""
    dwells = Dwells(np.array([5.0, 0.0, 9.0]), np.array([30, 17, 4]), 0.1)
    kernels = {White: lambda s, t: (s == t) / 0.1, GaussMarkov: lambda s, t: np.exp(-np.abs(s - t) / 2.0)}
    kernel = kernels.get(type(part), np.minimum)
    times = [start + 0.1 * np.arange(count) for start, count in zip(dwells.start_s, dwells.counts, strict=True)]
    expected = [[np.mean(kernel(s[:, None], t[None, :])) for t in times] for s in times]
    np.testing.assert_allclose(part.mean_covariance(dwells), ONE[:, None, None] ** 2 * expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    "noise",
    [
        Noise((White(1e-3 * ONE),)),
        Noise((GaussMarkov(1e-3 * ONE, 0.5),)),
        Noise((RandomWalk(1e-3 * ONE),)),
        Noise((White(1e-3 * ONE), Quantisation(5e-3 * ONE, 0.01))),
    ],
    ids=["white", "gauss-markov", "walk", "quantised"],
)
def test_allan_deviation_of_records_has_its_closed_form(noise):
    # GaussMarkov's form is for means of a continuous signal: 0.01 s samples of a 0.5 s process differ by < 1 %.
    samples = record(noise, 400_000, 0.01, seed=3)
    for axis, own in enumerate(samples.T):
        found = overlapping_allan([own], 100.0)
        kept = (found.dof > 400) & (found.tau_s >= 0.08)
        expected = noise.allan_deviation(found.tau_s[kept])[:, axis]
        spread = 1 / np.sqrt(2 * found.dof[kept])
        assert kept.sum() > 5
        assert np.all(np.abs(found.deviation[kept] / expected - 1) < 5 * spread + 0.01)


def test_the_papers_figures_are_met():
    noise = from_figures([(1.0, 1.2e-3), (100.0, 0.7e-3)])
    np.testing.assert_allclose(noise.allan_deviation(np.array([1.0, 100.0]))[:, 0], [1.2e-3, 0.7e-3], rtol=1e-6)
    # Hardly averaging down: the mean over 20 min is far above white noise's 1.2 mg / sqrt(1200).
    dwells = regular_dwells(24, dwell_s=1200.0, move_s=60.0, rate_hz=125.0)
    sd = np.sqrt(noise.mean_covariance(dwells)[0, 0, 0])
    assert sd > 10 * 1.2e-3 / np.sqrt(1200)


def test_a_static_record_gives_its_model_back():
    truth = Noise((White(1e-3 * ONE), Flicker(3e-4 * ONE, shortest_s=0.1)))
    fitted = from_record(record(truth, 2**18, 0.1, seed=1) + 1.0, 0.1)
    tau = np.array([0.2, 1.0, 10.0, 100.0])
    np.testing.assert_allclose(fitted.allan_deviation(tau), truth.allan_deviation(tau), rtol=0.08)
