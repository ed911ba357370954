"""Drift on all axes and a long warm-up: the same signal, told as one class; drift is the simpler word."""

import numpy as np

import blind_instrument as blind
import blind_noise
from tumblecal.diagnosis.sets.cause_sets import rows_of
from tumblecal.diagnosis.sets.prior import SetPriors


DRIFT = tuple(f"bias_drift.{axis}" for axis in blind.AXES)


def test_drift_on_three_axes_beside_a_second_order(diagnoser):
    """Twins of a measured set: the true set had no score where four steps lead to it; settling and squares were named."""
    rng, leading, in_class = np.random.default_rng([1, 12, 12, 1]), 0, 0
    truth = (*DRIFT, "second_order.y")
    for number in range(6):
        setup = blind.random_setup(rng, 3, 8)
        projector = blind.unreachable(setup)
        sizes = {name: 10 if name == "second_order.y" else 12 for name in truth}
        effects = {name: blind.sized(setup, projector, name, d, rng)[0] for name, d in sizes.items()}
        clean = blind.readings(setup, setup.nominal, effects)
        readings = clean + blind.SIGMA * rng.normal(size=clean.shape)
        diagnosis = diagnoser(blind_noise.position_set(setup, readings, known=bool(number % 2)))
        in_class += truth in (diagnosis.best.labels, *diagnosis.best.equivalents)
        leading += diagnosis.best.labels == truth
        assert diagnosis.best.labels == truth or diagnosis.verdict == "ambiguous"
    assert in_class >= 5 and leading >= 4


def warmed_up(seed, durations):
    """A warm-up of 12 sigma whose time constant is so many times the measurement's duration."""
    rng = np.random.default_rng(seed)
    setup = blind.random_setup(rng, 3, 8)
    plain, tau = blind.readings(setup, setup.nominal, {}), durations * np.ptp(setup.time_s)
    sizes = 1e-4 * np.array([1.0, -0.8, 0.9])
    signal = blind.readings(setup, setup.nominal, {"warm_up": [*sizes, tau]}) - plain
    sizes = sizes * 12 * blind.SIGMA / np.linalg.norm(blind.unreachable(setup) @ signal.ravel())
    clean = blind.readings(setup, setup.nominal, {"warm_up": [*sizes, tau]})
    return blind_noise.position_set(setup, clean + blind.SIGMA * rng.normal(size=clean.shape), known=bool(seed % 2))


def test_a_long_warm_up_is_a_drift(diagnoser):
    for seed in (1, 2):
        diagnosis = diagnoser(warmed_up(seed, 6.0))
        assert {DRIFT, ("warm_up",)} <= {diagnosis.best.labels, *diagnosis.best.equivalents}
        assert diagnosis.verdict == "ambiguous"


def test_a_warm_up_as_long_as_the_measurement_is_none(diagnoser):
    """Its time constant lies beyond those tried first; it was called a drift."""
    for seed in (1, 2, 3, 4):
        diagnosis = diagnoser(warmed_up(seed, 0.8))
        assert ("warm_up",) in (diagnosis.best.labels, *diagnosis.best.equivalents)


def with_time_constant(name, d, seed):
    """An effect of `d` sigma with a time constant drawn at random."""
    rng = np.random.default_rng([seed, d, len(name)])
    drawn = None
    while drawn is None:
        setup = blind.random_setup(rng, 3, 8) if seed % 4 < 2 else blind.random_setup(rng, 4, 12)
        drawn = blind.sized(setup, blind.unreachable(setup), name, d, rng)
    clean = blind.readings(setup, setup.nominal, {name: drawn[0]})
    return blind_noise.position_set(setup, clean + blind.SIGMA * rng.normal(size=clean.shape), known=bool(seed % 2))


def test_a_large_warm_up_is_one_effect_whatever_its_time_constant(diagnoser):
    """Two starts of one time constant were taken together, whose names are the same: a traceback."""
    assert diagnoser(with_time_constant("warm_up", 40, 8)).best.labels == ("warm_up",)


def test_a_rival_with_a_time_constant_is_judged_by_its_own_best(diagnoser):
    """The screen has it at its start: a drift beside it made up for that."""
    assert diagnoser(with_time_constant("warm_up", 20, 7)).best.labels == ("warm_up",)


def test_no_set_takes_an_effect_twice(diagnoser, hidden):
    pool = diagnoser(hidden(2, {})).screened.pool
    first, *others = next(same for k in range(pool.size) if len(same := np.flatnonzero(pool.starts == k)) > 1)
    (priors,) = SetPriors.of(pool, rows_of([(first,)])).with_each()
    assert len(others) >= 1 and np.all(priors[others] == -np.inf)
    assert np.sum(np.isinf(priors)) == len(others)
