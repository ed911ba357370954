"""The floor that positions repeat to, beside the sd of their means; simulated by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import blind_instrument as blind
from tumblecal.data import PositionSet
from tumblecal.estimation import exact, problem_of
from tumblecal.estimation.between_position_sd import between_position_sd


def measured(seed, floor_g):
    """A 3 x 8 set whose stated sd differ by up to a factor of four; the readings scatter by the floor as well."""
    rng = np.random.default_rng(seed)
    setup = blind.random_setup(rng, 3, 8)
    clean = blind.readings(setup, setup.nominal, {})
    sd = np.repeat(2e-5 * 4 ** rng.uniform(size=(len(clean), 1)), 3, axis=1)
    readings = clean + np.hypot(sd, floor_g) * rng.normal(size=clean.shape)
    data = PositionSet(tuple(setup.names), np.degrees(setup.alpha), np.degrees(setup.beta), readings, sd=sd)
    return setup, problem_of(data)


def test_floor_is_measured_and_intervals_hold_the_truth():
    floors, off = [], []
    for seed in range(40):
        setup, problem = measured(seed, 1e-4)
        floor = between_position_sd(exact.fit(problem))
        assert floor is not None
        floors.append(floor.floor_g)
        fit = exact.fit(floor.applied(problem))
        assert fit.noise == "estimated" and fit.level == pytest.approx(1.0, abs=0.1)
        truth = np.concatenate([setup.nominal["dK"], setup.nominal["bias"]])
        off += ((fit.values[:6] - truth) / (fit.sd[:6] * stats.t.ppf(0.975, fit.dof))).tolist()
    # The sd of one floor is 1/sqrt(2 dof): 7 %, of the mean of 40 1 %.
    assert np.mean(np.square(floors)) == pytest.approx(1e-8, rel=0.06)
    assert 0.91 < np.mean(np.abs(off) < 1) < 0.99


@pytest.mark.parametrize("stated", [1e-6, 1e-9, 1e-12])
def test_the_floor_is_the_same_however_small_the_stated_sd(stated):
    problem = measured(3, 1e-4)[1]
    floors = [
        between_position_sd(exact.fit(problem_of(replace(problem.data, sd=np.full((24, 3), sd)))))
        for sd in (1e-7, stated)
    ]
    assert floors[1].floor_g == pytest.approx(floors[0].floor_g, rel=1e-3)


def test_none_is_taken_where_the_stated_sd_is_right():
    taken = [between_position_sd(exact.fit(measured(seed, 0.0)[1])) is not None for seed in range(40)]
    assert sum(taken) <= 3  # 1 %: 4 of 40 once in 1600 runs


def twice(seed, error_g, scatter_g):
    """Each of 24 attitudes measured twice: an error of its own comes back, a scatter does not."""
    rng = np.random.default_rng(seed)
    setup = blind.random_setup(rng, 3, 8)
    clean = blind.readings(setup, setup.nominal, {})
    clean = clean + error_g * rng.normal(size=clean.shape)
    sd = np.full((48, 3), 2e-5)
    readings = np.tile(clean, (2, 1)) + np.hypot(2e-5, scatter_g) * rng.normal(size=sd.shape)
    names = tuple(f"{name}-{time}" for time in "ab" for name in setup.names)
    alpha, beta = (np.tile(np.degrees(angle), 2) for angle in (setup.alpha, setup.beta))
    return problem_of(PositionSet(names, alpha, beta, readings, sd=sd))


def test_repeats_tell_what_comes_back():
    error = between_position_sd(exact.fit(twice(1, 2e-4, 0.0)))
    assert error.floor_g == pytest.approx(2e-4, rel=0.25) and error.repeats_g < 2e-5
    assert "the model is wrong" in error.words
    scatter = between_position_sd(exact.fit(twice(2, 0.0, 2e-4)))
    assert scatter.repeats_g == pytest.approx(2e-4, rel=0.25)
    assert "the cause is their repeatability" in scatter.words
    assert between_position_sd(exact.fit(measured(3, 1e-4)[1])).repeats_g is None
