"""Noise that is larger in a part of the readings than in others: named as noise, and nothing invented beside it."""

import numpy as np
import pytest

import blind_instrument as blind
import blind_noise


def sd_at_a_setting(setup, readings):
    return np.where(setup.pitch == (setup.pitch.max() + 1) // 2, 8.0, 1.0)[:, None] * np.ones(3)


def sd_by_input(setup, readings):
    return np.hypot(0.3, 4.0 * readings)


def sd_in_a_run(setup, readings):
    return np.where(np.arange(len(readings)) >= 12, 6.0, 1.0)[:, None] * np.ones(3)


@pytest.mark.parametrize(
    ("sd", "words", "known", "seed"),
    [
        (sd_at_a_setting, "at beta 45 deg", True, 5),
        (sd_at_a_setting, "at beta 45 deg", False, 5),
        (sd_by_input, "input of 1 g", True, 6),
        (sd_by_input, "input of 1 g", False, 5),
        (sd_in_a_run, "in run 2", True, 5),
        (sd_in_a_run, "in run 2", False, 5),
    ],
)
def test_noise_that_is_larger_in_a_part_is_named_and_nothing_beside_it(diagnoser, sd, words, known, seed):
    """It was `unexplained`, or the name of some effect, with heavy tails."""
    rng = np.random.default_rng(seed)
    setup = blind.random_setup(rng, 3, 8)
    clean = blind.readings(setup, setup.nominal, {})
    noise = blind.SIGMA * sd(setup, clean) * rng.normal(size=clean.shape)
    positions = blind_noise.position_set(setup, clean + noise, known)
    if sd is sd_in_a_run:
        positions = type(positions)(**vars(positions) | {"run": ("1",) * 12 + ("2",) * 12})
    diagnosis = diagnoser(positions)
    assert diagnosis.labels == ("noise_unequal",) and words in diagnosis.noise_words


def test_an_effect_is_named_beside_a_setting_that_is_noisier(diagnoser):
    rng = np.random.default_rng(6)
    setup = blind.random_setup(rng, 4, 12)
    clean = blind.readings(setup, setup.nominal, {"second_order.y": np.array([3e-3])})
    readings = clean + blind.SIGMA * sd_at_a_setting(setup, clean) * rng.normal(size=clean.shape)
    diagnosis = diagnoser(blind_noise.position_set(setup, readings, known=True))
    assert ("second_order.y",) in (diagnosis.best.labels, *diagnosis.best.equivalents)
    assert "noise_unequal" in diagnosis.noise_wrong


def test_a_setting_with_two_of_four_positions_off_is_not_surely_noisier(diagnoser):
    """Both would explain it about as well, and both are said; eight times noisier throughout it is noise still."""
    rng, off, noisier = np.random.default_rng(13), 0, 0
    for _ in range(3):
        setup = blind.random_setup(rng, 3, 4)
        clean = blind.readings(setup, setup.nominal, {}) + blind.SIGMA * rng.normal(size=(12, 3))
        here = setup.pitch == 1
        two, all_four = clean.copy(), clean.copy()
        two[[4, 5]] += 14 * blind.SIGMA * rng.normal(size=(2, 3))
        all_four[here] += 8 * blind.SIGMA * rng.normal(size=(4, 3))
        told = diagnoser(blind_noise.position_set(setup, two, known=True))
        off += told.verdict != "identified" or "outlier_position" in told.labels[0]
        told = diagnoser(blind_noise.position_set(setup, all_four, known=True))
        noisier += "noise_unequal" in told.noise_wrong
    assert off == 3 and noisier >= 2
