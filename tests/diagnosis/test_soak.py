"""Effects of temperature are seen as well in an oven or a cold chamber as in the room: what counts is how it varies."""

from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
from tumblecal.diagnosis.refine.insert import fit_with


IDS = ("bias_temperature.x", "scale_temperature.y")
SEED = 3


def size(id):
    """The coefficient of 10 sigma at a temperature that wanders by a degree about that of a room."""
    setup = blind.random_setup(np.random.default_rng(SEED), 3, 8)
    sized = blind.sized(setup, blind.unreachable(setup), id, 10.0, np.random.default_rng(1))
    assert sized is not None
    return sized[0]


@pytest.mark.parametrize("degc", [85.0, pytest.param(-40.0, marks=pytest.mark.long)])
@pytest.mark.parametrize("id", IDS)
def test_temperature_effects_are_named_at_any_soak(hidden, diagnoser, id, degc):
    said, room = (diagnoser(hidden(SEED, {id: size(id)}, degc=where)) for where in (degc, 25.0))
    for diagnosis in (said, room):
        assert diagnosis.labels == (id,) and diagnosis.limits[id].visible_fraction > 0.2
        assert id not in diagnosis.invisible
    # The same wandering about another mean: the same limit, coefficient and sd, but for the scale factor of that axis,
    # which such a temperature has changed by some percent.
    assert said.limits[id].coefficients[id] == pytest.approx(room.limits[id].coefficients[id], rel=0.06)
    k = said.extended.names.index(id)
    assert said.extended.sd[k] == pytest.approx(room.extended.sd[k], rel=0.06)
    assert said.extended.values[k] == pytest.approx(room.extended.values[k], abs=0.2 * room.extended.sd[k])
    assert abs(said.extended.values[k] - size(id)[0]) < 4 * said.extended.sd[k]


@pytest.mark.long
@pytest.mark.parametrize("id", IDS)
def test_intervals_of_a_temperature_coefficient_hold_the_truth_at_85_degc(hidden, diagnoser, id):
    truth = size(id)
    at = (screened := diagnoser(hidden(SEED, {}, degc=85.0)).screened).at
    causes = [screened.pool.causes[screened.pool.labels.index(id)]]
    clean, rng, inside = hidden(SEED, {id: truth}, degc=85.0, noise=0.0).readings, np.random.default_rng(8), 0
    for _ in range(100):
        readings = clean + blind.SIGMA * rng.normal(size=clean.shape)
        fit = fit_with(replace(at, problem=replace(at.problem, readings=readings)), causes)
        k = fit.names.index(id)
        inside += abs(fit.values[k] - truth[0]) < 1.96 * fit.sd[k]
    # 95 %: 87 of 100 or fewer once in 700 runs, all 100 once in 170.
    assert 88 <= inside <= 99
