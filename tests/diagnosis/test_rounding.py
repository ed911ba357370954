"""Readings in steps, and a reading that stands in two rows: neither shows how large the noise is."""

from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
from blind_noise import position_set
from tumblecal.diagnosis.noise.rounding import steps


def measured(seed, plan=(3, 8), known=True):
    """Positions of an instrument in which nothing is wrong."""
    rng = np.random.default_rng([31, seed])
    setup = blind.random_setup(rng, *plan)
    readings = blind.readings(setup, setup.nominal, {})
    return position_set(setup, readings + blind.SIGMA * rng.normal(size=readings.shape), known)


@pytest.mark.parametrize("step", [1e-2, 5e-4, 2e-4, 1e-6])
def test_the_widest_decimal_step_is_found(step):
    rng = np.random.default_rng(3)
    readings = rng.normal(size=(24, 3))
    readings[:, :2] = np.round(readings[:, :2] / step) * step
    assert steps(readings) == pytest.approx([step, step, 0.0], rel=1e-12)


@pytest.mark.parametrize("plan", [(3, 8), (4, 12)])
def test_rounding_that_is_more_than_the_stated_noise_is_named_and_counts(diagnoser, plan):
    """Repeats that agreed exactly, or every reading its own cause: "every sd times 1e-12", unexplained, three outliers."""
    for seed in range(2):
        data = measured(seed, plan)
        diagnosis = diagnoser(replace(data, readings=np.round(data.readings, 3)))
        assert set(diagnosis.labels) == {"quantisation.x", "quantisation.y", "quantisation.z"}, diagnosis.labels
        # Of independent rounding errors of 1 mg and the noise.
        expected = np.hypot(1e-3 / np.sqrt(12), blind.SIGMA)
        assert diagnosis.nominal.rms == pytest.approx(expected, rel=0.5)


def test_rounding_within_the_stated_noise_changes_nothing(diagnoser):
    data = measured(2)
    assert diagnoser(replace(data, readings=np.round(data.readings, 4))).verdict == "adequate"


def test_a_reading_written_twice_is_no_repeat_that_shows_no_noise(diagnoser):
    """What no entry describes led surely, as it came back in the repeat to the last digit."""
    for seed in range(3):
        data, rows = measured(seed, known=False), [*range(23), 5]
        assert data.time_s is not None
        columns = ("alpha_deg", "beta_deg", "readings", "temperature_degc", "approach")
        again = {name: getattr(data, name)[rows] for name in columns if getattr(data, name) is not None}
        again["time_s"] = data.time_s
        assert diagnoser(replace(data, names=(*data.names[:-1], "again"), **again)).verdict == "adequate"


def test_equal_readings_at_the_ends_of_a_range_are_clipped(diagnoser):
    """One position at either end, at no round number: far from the noise, and not refused."""
    data = measured(0)
    limit = np.sort(np.abs(data.readings[:, 2]))[-2] - 9.87654e-4
    readings = data.readings.copy()
    readings[:, 2] = np.clip(readings[:, 2], -limit, limit)
    assert np.sum(np.abs(readings[:, 2]) == limit) == 2
    assert "clipping.z" in diagnoser(replace(data, readings=np.round(readings, 7))).best.labels
