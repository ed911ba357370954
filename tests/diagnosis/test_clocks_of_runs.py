"""Runs whose clock starts anew: switched on again for each, or one measurement whose clock was set back."""

from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
from blind_noise import position_set
from tumblecal.chain import settings


def two_runs(rng):
    """Two runs of 3 x 8 positions of one instrument, times from 0 in each."""
    setup = blind.random_setup(rng, 3, 8)
    time = setup.time_s - setup.time_s[0]
    whole = replace(
        setup,
        **{
            name: np.tile(getattr(setup, name), 2)
            for name in ("alpha", "beta", "temperature_degc", "approach", "pitch")
        },
        time_s=np.tile(time, 2),
        names=[f"{run}-{name}" for run in "ab" for name in setup.names],
    )
    return whole, np.repeat([1, 2], len(time))


@pytest.mark.parametrize(("hidden", "anew"), [("warm_up", True), ("bias_drift.y", False)])
def test_what_each_run_shows_anew_is_told_by_its_clock_and_what_goes_on_by_all_of_them(diagnoser, hidden, anew):
    """A warm-up in every run was `unexplained`, its times taken as going on."""
    rng = np.random.default_rng(31)
    setup, run = two_runs(rng)
    going_on = replace(setup, time_s=setup.time_s + run * (setup.time_s.max() + 60.0))
    if anew:
        readings = blind.readings(setup, setup.nominal, {"warm_up": [2e-3, -1.5e-3, 1e-3, 400.0]})
    else:
        readings = blind.readings(going_on, setup.nominal, {"bias_drift.y": [4e-7]})
    readings = readings + blind.SIGMA * rng.normal(size=readings.shape)
    data = replace(position_set(setup, readings, known=True), run=tuple(str(number) for number in run))
    diagnosis = diagnoser(data)
    assert (hidden,) in (diagnosis.best.labels, *diagnosis.best.equivalents) and diagnosis.verdict == "identified"
    # Runs that have a clock each are no slip.
    assert not diagnosis.setup_errors


def test_runs_with_a_clock_each_are_measured_one_after_the_other():
    time = [0.0, 10.0, 20.0, 1.0, 11.0, 21.0]
    where = settings(np.zeros(6), np.zeros(6), run=["1"] * 3 + ["2"] * 3, time_s=time)
    assert np.all(np.diff(where.measuring_order) > 0)
    # Rows of one run in another order than they were measured in stay where their times say.
    where = settings(np.zeros(3), np.zeros(3), time_s=[20.0, 0.0, 10.0])
    assert where.measuring_order.tolist() == [2.0, 0.0, 1.0]
