"""Repeats are pure error: what comes back when an attitude is repeated is an error of the model, not noise."""

import numpy as np
import pytest

import blind_instrument as blind
import blind_noise
from blind import conditions as blind_conditions
from tumblecal.data import PositionSet
from tumblecal.report.diagnosis_verdict import verdict_of_diagnosis


def measured_twice(seed: int, how: str, known: bool, error) -> PositionSet:
    """3 x 8 positions measured twice; `error(rng, clean)` is added to the readings beside white noise."""
    rng = np.random.default_rng(seed)
    setup = blind_conditions.twice(blind.random_setup(rng, 3, 8), how)
    clean = blind.readings(setup, setup.nominal, {})
    readings = clean + blind.SIGMA * (rng.normal(size=clean.shape) + error(rng, clean))
    data = blind_noise.position_set(setup, readings, known)
    runs = tuple("1" * 24 + "2" * 24) if how == "two runs" else None
    return PositionSet(**vars(data) | {"run": runs})


def of_the_attitude(rng, clean):
    own = 3 * rng.normal(size=(len(clean) // 2, 3))
    return np.vstack([own, own])


def of_the_attitude_on_one_axis(rng, clean):
    """About 14 sigma together."""
    own = 2 * rng.normal(size=(len(clean) // 2, 1)) * (np.arange(3) == rng.integers(3))
    return np.vstack([own, own])


def of_two_attitudes(rng, clean):
    own = np.zeros((len(clean) // 2, 3))
    own[rng.choice(len(own), 2, replace=False)] = 6 * np.sign(rng.normal(size=(2, 3)))
    return np.vstack([own, own])


def of_the_reading(rng, clean):
    return 3 * np.cross(rng.normal(size=clean.shape), clean)


# Each way of repeating with the noise stated and unknown, and with both errors.
@pytest.mark.parametrize(
    ("how", "known", "seed", "error"),
    [
        ("one run", True, 1, of_the_attitude),
        ("one run", False, 4, of_the_attitude_on_one_axis),
        ("two runs", True, 4, of_the_attitude_on_one_axis),
        ("two runs", False, 1, of_the_attitude),
    ],
)
def test_an_error_that_comes_back_is_no_noise(diagnoser, how, known, seed, error):
    diagnosis = diagnoser(measured_twice(seed, how, known, error))
    assert diagnosis.labels == ("unexplained",) and diagnosis.verdict == "unexplained"
    assert "repeats of an attitude agree" in verdict_of_diagnosis(diagnosis).words()


def test_two_attitudes_off_in_every_repeat_are_no_heavy_tails(diagnoser):
    diagnosis = diagnoser(measured_twice(2, "one run", False, of_two_attitudes))
    assert not diagnosis.noise_wrong and ("unexplained",) in (diagnosis.best.labels, *diagnosis.best.equivalents)


@pytest.mark.parametrize(("seed", "how", "known"), [(1, "one run", True), (2, "two runs", False)])
def test_an_attitude_that_does_not_repeat_is_noise(diagnoser, seed, how, known):
    assert diagnoser(measured_twice(seed, how, known, of_the_reading)).labels == ("noise_attitude",)


def test_repeats_of_a_right_model_are_adequate(diagnoser):
    for seed in range(2):
        data = measured_twice(seed, "one run", seed % 2 == 0, lambda rng, clean: 0.0)
        assert diagnoser(data).verdict == "adequate"
