"""The plan of the rest of a measurement, against generalised least squares in numpy and all short plans."""

from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np
import pytest

from tumblecal.chain.head_ability import SlowNoise
from tumblecal.design.criteria.criterion import worst
from tumblecal.design.model.cells import cells_of
from tumblecal.design.model.evaluation import uncertainties
from tumblecal.design.model.limits import in_order
from tumblecal.design.model.one_visit import one_visit
from tumblecal.design.model.responses import Responses, responses_of
from tumblecal.design.model.schedule import continued, schedule
from tumblecal.design.sequential.ahead import Planner


MEASURED = [0, 2, 5, 8, 11, 14, 16, 19, 27, 30]


@pytest.fixture(scope="module")
def planner(head) -> Planner:
    """One mounting, no slow noise, ten positions measured at three pitch settings."""
    ability = replace(head.ability, mounts=("A",), slow_noise=SlowNoise())
    here: Responses = responses_of(head, cells_of(ability))
    measured = schedule(here.cells, np.array(MEASURED), ability.times)
    return Planner(here, ability, worst(here), measured, np.arange(len(here.cells)) != MEASURED[-1])


def test_a_plan_continues_the_present_visit(planner: Planner) -> None:
    """The model of the search has the uncertainties of the schedule, with the settings of the measured positions."""
    further = in_order(planner.responses.cells, [25, 28, 1, 3, 20, 33, 38], MEASURED[-1])
    assert planner.measured is not None
    planned = continued(planner.responses.cells, planner.measured, further, planner.ability.times)
    found = np.sqrt(np.diag(one_visit(planner.responses, running=planner.measured).covariance(further)))
    exact = uncertainties(planner.responses, planned, planner.ability)
    sensor = [k for k, name in enumerate(exact.names) if name.split("_")[0] in ("dK", "bias", "gamma")]
    assert found[sensor] == pytest.approx((exact.sd / exact.scales)[sensor], rel=1e-3)
    # The present pitch setting comes first, without a change.
    assert set(planner.responses.cells.pitch[further[:2]]) == {planner.responses.cells.pitch[MEASURED[-1]]}
    assert planned.pitch_visit[10] == planned.pitch_visit[9]


def test_the_shortest_plan_reaches_the_goal_in_the_least_time(planner: Planner) -> None:
    """Of all plans of one or two positions in the same or less time none reaches the goal that the plan found reaches."""
    assert planner.measured is not None
    cells, times, now = planner.responses.cells, planner.ability.times, planner.value(planner.measured)
    open_cells = np.flatnonzero(planner.allowed)[::2]
    every = {
        pair: continued(cells, planner.measured, in_order(cells, list(dict.fromkeys(pair)), MEASURED[-1]), times)
        for pair in combinations_with_replacement(open_cells.tolist(), 2)
    }
    value = {pair: planner.value(planned) for pair, planned in every.items()}
    best = min(value.values())
    goal = best + 0.2 * (now - best)
    least = min(planned.end_s for pair, planned in every.items() if value[pair] <= goal)
    found = planner.plan(np.inf, goal)
    assert found is not None and found.value <= goal and found.value == planner.value(found.schedule)
    assert found.schedule.end_s <= least + times.dwell_s + times.settle_s
    assert planner.allowed[found.cells].all()


def test_a_plan_uses_the_remaining_time_if_the_goal_is_out_of_reach(planner: Planner) -> None:
    assert planner.measured is not None
    for goal in (None, 1e-9):
        found = planner.plan(600.0, goal)
        assert found is not None and 0 < found.schedule.end_s - planner.measured.end_s <= 600.0
        assert found.value < planner.value(planner.measured)
    assert planner.plan(50.0) is None and planner.plan(50.0, 0.1) is None
    assert replace(planner, allowed=np.zeros(len(planner.allowed), bool)).plan(600.0) is None
    # The first positions of a measurement.
    found = replace(planner, measured=None).plan(900.0)
    assert found is not None and found.schedule.end_s <= 900.0
