"""A confirming measurement: what it predicts is what an instrument with the cause shows, and one without it does not."""

import numpy as np
import pytest

import blind_instrument as blind
from blind_noise import position_set
from blind_sets import measured
from tumblecal.diagnosis import Diagnoser
from tumblecal.effects import catalogue
from tumblecal.estimation import exact, problem_of
from tumblecal.estimation.position_problem import where_of
from tumblecal.plan.next.next_plan import next_plan
from tumblecal.plan.next.proposals import Allowed


AXES = "xyz"


@pytest.fixture(scope="module")
def diagnoser():
    """With few effects: their model is compiled quickly."""
    entries = catalogue()
    kept = ("second_order.y", "index_eccentricity", "bias_drift.x")
    return Diagnoser({id: effect for id, effect in entries.items() if id in kept or effect.make is None}, nested=False)


@pytest.mark.parametrize("name", ["second_order.y", "index_eccentricity"])
def test_the_instrument_reads_what_is_predicted_under_the_cause_and_not_under_its_rival(diagnoser, name):
    """True readings at the proposed positions, from the simulator that hid the effect; rivals' from an exact nominal fit."""
    towards_cause, told = [], 0
    for seed in range(5):
        rng = np.random.default_rng(4000 + seed)
        setup = blind.random_setup(rng, 3, 8)
        drawn = blind.sized(setup, blind.unreachable(setup), name, 12.0, rng)
        assert drawn is not None
        effects = {name: drawn[0]}
        data = measured(setup, effects, rng)
        diagnosis = diagnoser(data)
        assert diagnosis.labels == (name,)
        confirming = next_plan(diagnosis, Allowed(remount=False)).confirming
        assert confirming
        assert [reading.sd_apart for reading in confirming] == sorted(
            (reading.sd_apart for reading in confirming), reverse=True
        )
        cells = [(reading.alpha_deg, reading.beta_deg) for reading in confirming]
        more = blind.extended(setup, cells, rng)
        true = blind.readings(more, more.nominal, effects)[len(data) :]
        nominal = exact.fit(problem_of(data))
        alone = np.asarray(nominal.chain(where_of(position_set(more, np.zeros((len(more.alpha), 3)), known=True))))
        for reading, truth, without in zip(confirming, true, alone[len(data) :], strict=True):
            axis = AXES.index(reading.axis)
            told += 1
            towards_cause.append((truth[axis] - reading.rival_g) / (reading.expected_g - reading.rival_g))
            if not reading.rival:
                assert reading.rival_g == pytest.approx(without[axis], abs=0.05 * reading.sd_g)
    # One where the cause is right: 12 sd in all, so its size is known to a twelfth.
    assert told >= 10 and abs(np.mean(towards_cause) - 1.0) < 0.15


@pytest.mark.long
def test_the_sd_of_what_is_predicted_under_the_cause_holds_how_well_its_size_is_known(diagnoser):
    """A drift is known to some tenth and counted on: the instrument read up to six sd of the rival's prediction beside it."""
    away = []
    for seed in range(12):
        rng = np.random.default_rng(4200 + seed)
        setup = blind.random_setup(rng, 3, 8)
        drawn = blind.sized(setup, blind.unreachable(setup), "bias_drift.x", 8.0, rng)
        assert drawn is not None
        effects = {"bias_drift.x": drawn[0]}
        data = measured(setup, effects, rng)
        diagnosis = diagnoser(data)
        if diagnosis.labels != ("bias_drift.x",):
            continue
        for reading in next_plan(diagnosis, Allowed(remount=False)).confirming[:1]:
            more = blind.extended(setup, [(reading.alpha_deg, reading.beta_deg)], rng)
            step = np.ptp(setup.time_s) / (len(setup.time_s) - 1)
            more.time_s[-1] = setup.time_s.max() + step
            true = blind.readings(more, more.nominal, effects)[-1, AXES.index(reading.axis)]
            true += blind.SIGMA * rng.normal()
            away.append((true - reading.expected_g) / reading.expected_sd_g)
    assert len(away) >= 8 and np.sqrt(np.mean(np.square(away))) < 1.6
