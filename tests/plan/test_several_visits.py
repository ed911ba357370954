"""Bounds of plans that visit settings several times, the fewest remounts, and starts that exceed the limits."""

from dataclasses import replace
from itertools import pairwise, permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tumblecal.plan.bounds import bounds
from tumblecal.plan.criterion import of_parameters
from tumblecal.plan.exchange import Term, exchange
from tumblecal.plan.information import one_visit, uncertainties
from tumblecal.plan.limits import Limits, in_order, most_visits, sittings_in_order
from tumblecal.plan.schedule import schedule


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
        several = bounds(one_visit(responses, most=most_visits(limits)), criterion, limits, found.cells).white
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
    assert most_visits(limits) == (8, 1)
    once = bounds(one_visit(few), criterion, limits, every).white
    several = bounds(one_visit(few, most=(8, 1)), criterion, limits, every).white
    one_each, eight_each = (
        value(few, criterion, schedule(few.cells, order, ability.times), ability)
        for order in (every, every.reshape(3, 8).T.ravel())
    )
    assert one_each == pytest.approx(once, rel=5e-3)
    assert several * (1 - 1e-9) <= eight_each < 0.6 * once


@settings(max_examples=60, deadline=None)
@given(st.sets(st.tuples(st.integers(0, 2), st.integers(0, 2)), min_size=1, max_size=6))
def test_temperatures_upwards_with_few_remounts(pairs):
    def remounts(order):
        return sum(first[1] != then[1] for first, then in pairwise(order))

    least, found = sittings_in_order(frozenset(pairs))
    upwards = [one for one in permutations(pairs) if [soak for soak, _ in one] == sorted(soak for soak, _ in pairs)]
    assert found in upwards and remounts(found) == least <= min(map(remounts, upwards)) + 1
