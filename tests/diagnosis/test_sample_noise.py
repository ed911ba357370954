"""The noise of position means from their raw samples: its covariance, and that it weighs and is no effect."""

from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
from blind_noise import position_set
from tumblecal.estimation.mean_noise import sample_noises
from tumblecal.ground.errors import InputError
from tumblecal.noise import Dwells, Flicker, Noise, White
from tumblecal.noise.sampling import dwell_records
from tumblecal.recordings.dwells.dwell_samples import DwellSamples
from tumblecal.show.diagnosis import verdict_of_diagnosis


RATE, COUNT = 50.0, 3000
ONE = np.ones(3)


def recorded(seed, parts, effects=(), extra=0.0):
    """Means and raw samples of a run with a noise model, 60 s dwells every 80 s."""
    rng = np.random.default_rng(seed)
    setup = blind.random_setup(rng, 3, 8)
    clean = blind.readings(setup, setup.nominal, dict(effects))
    dwells = Dwells(np.arange(24) * 80.0, COUNT, 1 / RATE)
    records = list(dwell_records(Noise(parts), dwells, seed, clean + extra * rng.normal(size=clean.shape)))
    middle = dwells.start_s + 30.0
    means = np.array([force.mean(0) for force in records])
    data = replace(position_set(setup, means, known=False), time_s=middle, source="means")
    return data, DwellSamples(replace(data, source="raw"), records, RATE), dwells


def against_neighbours(covariance):
    """Sd of a mean against the next, from the covariance of all."""
    diagonal = np.array([np.diag(own) for own in covariance])
    steps = diagonal[:, 1:] + diagonal[:, :-1] - 2 * np.array([np.diag(own, 1) for own in covariance])
    return np.sqrt(np.mean(steps, axis=1) / 2)


def test_covariance_of_means_is_that_of_the_true_noise():
    parts = (White(100e-6 * ONE), Flicker(60e-6 * np.array([1.0, 2.0, 3.0])))
    data, samples, dwells = recorded(1, parts)
    noises = {noise.lasts: noise for noise in sample_noises(samples, data) if noise.level == 1}
    truth = Noise(parts).mean_covariance(dwells)
    np.testing.assert_allclose(against_neighbours(noises["flicker"].covariance), against_neighbours(truth), rtol=0.2)
    np.testing.assert_allclose(np.median(noises["flicker"].sd, axis=0), against_neighbours(truth), rtol=0.2)
    far = truth[2, 0, 0] + truth[2, 23, 23] - 2 * truth[2, 0, 23]
    lasting = noises["flicker"].covariance[2]
    assert lasting[0, 0] + lasting[23, 23] - 2 * lasting[0, 23] == pytest.approx(far, rel=0.4)
    np.testing.assert_allclose(np.median(noises["white"].sd, axis=0), 100e-6 / np.sqrt(60), rtol=0.05)


def test_slow_noise_of_raw_samples_weighs_the_positions(diagnoser):
    data, samples, _ = recorded(3, (White(100e-6 * ONE), Flicker(60e-6 * ONE)), {"second_order.y": [1.5e-3]})
    diagnosis = diagnoser(data, samples=samples)
    assert diagnosis.samples.lasts == "flicker" and diagnosis.problem.correlated
    assert {"second_order.y"} in [set(diagnosis.best.labels), *map(set, diagnosis.best.equivalents)]
    text = verdict_of_diagnosis(diagnosis).words()
    assert "times too small" in text and "correlated" in text and "treated as unknown" in text
    assert 0.6 < diagnosis.extended.level < 1.6


def test_samples_of_something_else_are_refused(diagnoser):
    data, samples, _ = recorded(5, (White(100e-6 * ONE),))
    third = data.names.index("1-3")
    other = replace(samples, force=[samples.force[k + (k == third)] for k in range(len(data))])
    with pytest.raises(InputError, match="position 1-3: the samples' mean of axis"):
        sample_noises(other, data)
    rest = [k for k, name in enumerate(data.names) if name != "2-2"]
    fewer = replace(samples, positions=samples.positions.chosen(rest), force=[samples.force[k] for k in rest])
    with pytest.raises(InputError, match="no samples of position 2-2 of means"):
        sample_noises(fewer, data)
