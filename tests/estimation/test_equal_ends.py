"""Equal readings at the end of a range: clipped, or chance."""

import numpy as np
import pytest

import blind_instrument as blind
import blind_noise
from tumblecal.estimation.setup.correction import correct_setup_errors
from tumblecal.estimation.setup.unmeasured import equal_ends
from tumblecal.ground.errors import InputError


def measured(seed: int, settings: int = 3, angles: int = 8) -> tuple[blind.Setup, np.ndarray]:
    rng = np.random.default_rng(seed)
    setup = blind.random_setup(rng, settings, angles)
    return setup, blind.readings(setup, setup.nominal, {}) + blind.SIGMA * rng.normal(size=(settings * angles, 3))


def clipped(readings: np.ndarray, axis: int, limit: float) -> np.ndarray:
    readings = readings.copy()
    readings[:, axis] = np.clip(readings[:, axis], -limit, limit)
    return readings


@pytest.mark.parametrize("axis", [0, 2])
def test_equal_readings_at_both_ends_or_at_a_whole_setting_are_clipped(axis):
    """Axis x reads its largest at the 8 positions of a setting, z at one position of either sign."""
    setup, readings = measured(5)
    assert np.all(np.sort(np.abs(readings[:, axis]))[-2:] > 0.993)
    readings = np.round(clipped(readings, axis, 0.993), 7)
    (end, *_) = equal_ends(readings)
    assert end.axis == axis and end.size == 0.993
    assert end.rows.tolist() == np.flatnonzero(np.abs(readings[:, axis]) == 0.993).tolist()
    with pytest.raises(InputError, match=rf"reads 0.993 g.*\(clipping.{'xyz'[axis]}\)"):
        correct_setup_errors(blind_noise.position_set(setup, readings, True), None)


@pytest.mark.parametrize("decimals", [5, 6, 7])
def test_readings_that_are_equal_by_chance_are_kept(decimals):
    for seed in range(60):
        _, readings = measured(seed, 4, 12)
        assert all(end.chance > 1e-4 for end in equal_ends(np.round(readings, decimals)))
