"""Bounds of plans that visit settings several times, the fewest remounts, and starts that exceed the limits."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tumblecal.plan.bound import bounds
from tumblecal.plan.cells import Cells
from tumblecal.plan.criterion import of_parameters
from tumblecal.plan.exchange import Term, exchange
from tumblecal.plan.information import one_visit, uncertainties
from tumblecal.plan.limits import Limits, in_order, schedule


def value(responses, criterion, planned, ability):
    """Under white noise, with the visits of the schedule."""
    return float(criterion.of(uncertainties(responses, planned, ability).covariance))


@pytest.fixture(scope="module")
def unsteady(head, candidates):
    """A head whose pitch settings and mountings differ at each visit."""
    few = replace(
        candidates,
        pitch=replace(candidates.pitch, common=1.0, again=0.3),
        mount=replace(candidates.mount, common=3.0, again=1.0),
    )
    return few, head.ability


def test_no_order_is_better_than_the_bound_of_several_visits(unsteady):
    """Random orders of random positions, and of good ones."""
    responses, ability = unsteady
    cells, rng, count = responses.cells, np.random.default_rng(4), 12
    for criterion in [of_parameters(combine, responses) for combine in ("largest", "mean")]:
        limits = Limits(cells, ability.times, np.ones(80, bool), count)
        found = exchange(limits, [Term(((one_visit(responses), criterion),))], restarts=1)
        once = bounds(one_visit(responses), criterion, limits, found.cells).white
        several = bounds(one_visit(responses, most=limits.most_visits), criterion, limits, found.cells).white
        # A relaxation ends at 0.5 % of the value.
        assert several < 1.005 * once
        orders = [rng.choice(80, count, replace=False) for _ in range(100)]
        for _ in range(25):
            half = np.array_split(rng.permutation(found.cells), 2)
            orders += [
                np.stack([half[0], half[1]], axis=1).ravel(),
                in_order(cells, found.cells)[rng.permutation(count)],
            ]
        values = [value(responses, criterion, schedule(cells, order, ability.times), ability) for order in orders]
        assert min(values) >= several


def test_repeated_visits_can_be_better_than_one_visit_each(head, candidates):
    """In one mounting the errors of pitch settings are confounded with the x axis, and repeated settings average them."""
    cells, ability = candidates.cells, head.ability
    few = candidates.chosen(np.flatnonzero((cells.mounting == 0) & np.isin(cells.beta_deg, (0, 45, 90))))
    few = replace(few, pitch=replace(few.pitch, common=0.0, again=0.3), mount=replace(few.mount, common=0.0, again=0.0))
    criterion, every = of_parameters("largest", few), np.arange(24)
    limits = Limits(few.cells, ability.times, np.ones(24, bool), 24)
    assert limits.most_visits == (8, 1)
    once = bounds(one_visit(few), criterion, limits, every).white
    several = bounds(one_visit(few, most=(8, 1)), criterion, limits, every).white
    one_each, eight_each = (
        value(few, criterion, schedule(few.cells, order, ability.times), ability)
        for order in (every, every.reshape(3, 8).T.ravel())
    )
    assert one_each == pytest.approx(once, rel=5e-3)
    assert several * (1 - 1e-9) <= eight_each < 0.6 * once


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(0, 99), min_size=1, max_size=12), st.none() | st.integers(0, 99))
def test_each_setting_is_visited_once_and_temperatures_go_upwards(taken, present):
    rows = [(90.0 * k, beta, mount) for mount in "AB" for beta in (-30.0, 0.0, 30.0, 60.0, 90.0) for k in range(5)]
    cells = Cells.listed(rows * 2, np.repeat([0.0, 50.0], 50))
    order = in_order(cells, taken, present)
    assert sorted(order.tolist()) == sorted(taken)
    for label in (cells.soak, cells.sitting, cells.group):
        assert sum(one != other for one, other in pairwise(label[order])) == len({*label[order].tolist()}) - 1
    soaks = dict.fromkeys(cells.soak[order].tolist())
    assert [*soaks] == sorted(soaks, key=lambda one: (present is not None and one != cells.soak[present], one))
