"""Bounds of plans: never above the best of all plans, and close to it; the relaxation against general-purpose minimisation."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import minimize

from tumblecal.chain.head_ability import Times
from tumblecal.plan.bound import bounds
from tumblecal.plan.criterion import of_parameters, weighted
from tumblecal.plan.information import one_visit
from tumblecal.plan.limits import Limits, in_order, schedule


FEW = np.r_[8:12, 25:28, 48:50, 64:66]


@pytest.fixture(scope="module")
def model(candidates):
    return one_visit(candidates)


def covariance(model, weights):
    """Of the shared parameters for weights of all cells, from the whole information, in numpy."""
    total = model.information + np.einsum("c,cap,caq->pq", weights, model.columns, model.columns)
    return np.linalg.inv(total)[: len(model.names), : len(model.names)]


def plans(cells, ability, most_minutes, sizes):
    for size in sizes:
        for plan in combinations(FEW, size):
            if schedule(cells, in_order(cells, plan), ability.times).minutes <= most_minutes:
                yield plan


@pytest.mark.parametrize(("build", "minutes"), [("largest", None), ("mean", None), ("both", None), ("volume", 16.0)])
def test_no_plan_is_better_than_its_bound(head, candidates, model, build, minutes):
    times = Times(dwell_s=60, settle_s=0, turn_s=10, pitch_change_s=100, remount_s=150)
    ability, cells = replace(head.ability, times=times), candidates.cells
    both = [of_parameters(one, candidates) for one in (("largest", "mean") if build == "both" else (build,))]
    criterion = weighted(both, (1, 2)) if build == "both" else both[0]
    allowed = np.isin(np.arange(80), FEW)
    limits = Limits(cells, times, allowed, **({"count": 7} if minutes is None else {"seconds": 60 * minutes}))
    sizes = (7,) if minutes is None else range(6, 11)
    every = {
        plan: float(criterion.of(covariance(model, np.isin(np.arange(80), plan) * 1.0)))
        for plan in plans(cells, ability, minutes or np.inf, sizes)
    }
    best = min(every, key=lambda plan: every[plan])
    found = bounds(model, criterion, limits, best)
    assert found.value == pytest.approx(every[best], rel=1e-6)
    assert found.white <= found.own <= every[best] * (1 + 1e-12)  # two ways to compute one value
    # The bound does not depend on the plan that is known, and it is not an empty one.
    other = bounds(model, criterion, limits, max(every, key=lambda plan: every[plan]))
    assert other.white <= every[best] * (1 + 1e-9)
    assert found.white > 0.8 * every[best]
    assert bool(found.reason) == (found.efficiency < 0.95)


def test_the_bound_of_a_number_of_positions_is_the_least_of_its_relaxation(candidates, model, head):
    """Fractions of positions by SLSQP in numpy: the mean variance is smooth."""
    criterion = of_parameters("mean", candidates)
    start = np.zeros(80)
    start[FEW] = 7 / len(FEW)

    def least(fractions):
        weights = np.zeros(80)
        weights[FEW] = fractions
        return np.log(criterion.of(covariance(model, weights)))

    expected = minimize(
        least,
        start[FEW],
        method="SLSQP",
        bounds=[(0, 1)] * len(FEW),
        constraints={"type": "eq", "fun": lambda w: w.sum() - 7},
    )
    limits = Limits(candidates.cells, head.ability.times, np.isin(np.arange(80), FEW), 7)
    found = bounds(model, criterion, limits, FEW[:7])
    assert np.log(found.white) == pytest.approx(expected.fun, abs=3e-3)
    assert np.log(found.white) <= expected.fun + 1e-6
