"""The choice of positions: against enumeration of all plans, and updates of rank three against direct inverses, in numpy."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tumblecal.chain.head_ability import Times
from tumblecal.ground.errors import InputError
from tumblecal.plan.criterion import Criterion, Part, determined, of_parameters
from tumblecal.plan.exchange import Selection, Term, exchange
from tumblecal.plan.information import one_visit, uncertainties
from tumblecal.plan.limits import Limits, in_order, schedule


# Ten cells, of two pitch settings in each of two mountings.
FEW = np.r_[8:11, 25:28, 48:50, 64:66]


@pytest.fixture(scope="module")
def model(candidates):
    return one_visit(candidates)


def value(model, rows, cells, combine):
    """A criterion from the inverse of the whole information, in numpy."""
    columns = model.columns[list(cells)].reshape(-1, model.columns.shape[2])
    full = np.linalg.inv(model.information + columns.T @ columns)[: len(model.names), : len(model.names)]
    of_rows = rows @ full @ rows.T
    if combine == "volume":
        return np.linalg.det(of_rows) ** (0.5 / len(rows))
    return np.sqrt({"largest": np.max, "mean": np.mean}[combine](np.diag(of_rows)))


def test_the_model_of_a_search_gives_the_covariance_of_its_schedule(head, candidates, model):
    taken = in_order(candidates.cells, np.r_[0:5, 9:14, 18:20, 40:47, 58:62])
    planned = schedule(candidates.cells, taken, head.ability.times)
    exact = uncertainties(candidates, planned, head.ability).covariance
    assert len(np.unique(planned.pitch_visit)) == len(np.unique(candidates.cells.group[taken]))
    assert np.sqrt(np.diag(model.covariance(taken))) == pytest.approx(np.sqrt(np.diag(exact)), rel=1e-4)


@pytest.mark.parametrize("seed", range(6))
def test_updates_are_direct_inverses(candidates, model, seed):
    rng = np.random.default_rng(seed)
    cells, more = rng.integers(80, size=rng.integers(1, 30)), int(rng.integers(80))
    combine = ["largest", "mean", "volume"][seed % 3]
    criterion = of_parameters(combine, candidates)
    limits = Limits(candidates.cells, None, np.ones(80, bool))
    measure = Selection(limits, [Term(((model, criterion),))], cells)
    for step in (more, (more + 31) % 80):
        measure.add(step)
    measure.add(int(cells[0]), -1)
    kept = list(measure.cells)
    added, removed = measure.if_changed(np.arange(80), 1), measure.if_changed(kept, -1)
    direct = [value(model, criterion.parts[0].rows, taken, combine) for taken in (kept, [*kept, 17], kept[:-1])]
    assert [measure.value, added[17], removed[-1]] == pytest.approx(direct, rel=2e-3)


@pytest.mark.parametrize("combine", ["largest", "mean", "volume"])
def test_the_best_plan_of_all_is_found(head, candidates, model, combine):
    criterion = of_parameters(combine, candidates)
    allowed = np.isin(np.arange(80), FEW)
    limits = Limits(candidates.cells, head.ability.times, allowed, 6)
    found = exchange(limits, [Term(((model, criterion),))], restarts=6)
    every = [value(model, criterion.parts[0].rows, plan, combine) for plan in combinations(FEW, 6)]
    assert found.value == pytest.approx(min(every), rel=1e-6)
    assert found.value == pytest.approx(value(model, criterion.parts[0].rows, found.cells, combine), rel=1e-6)


def test_the_best_plan_in_a_time_is_found(head, candidates, model):
    """All plans that fit, of any number of positions; the duration is that of the schedule, in minutes."""
    ability = replace(head.ability, times=Times(dwell_s=60, settle_s=0, turn_s=0, pitch_change_s=100, remount_s=150))
    criterion, cells = of_parameters("mean", candidates), candidates.cells
    allowed = np.isin(np.arange(80), FEW)
    limits = Limits(cells, ability.times, allowed, seconds=660.0)
    found = exchange(limits, [Term(((model, criterion),))], restarts=4)
    every = [
        value(model, criterion.parts[0].rows, plan, "mean")
        for size in range(1, 11)
        for plan in combinations(FEW, size)
        if schedule(cells, in_order(cells, plan), ability.times).minutes <= 11.0
    ]
    assert found.value == pytest.approx(min(every), rel=1e-6)
    assert schedule(cells, found.cells, ability.times).minutes <= 11.0


@given(st.lists(st.integers(0, 79), min_size=1, max_size=25), st.none() | st.integers(0, 79))
@settings(max_examples=30, deadline=None)
def test_durations_are_those_of_the_schedule(head, candidates, cells, present):
    times, start = head.ability.times, () if present is None else (present,)
    limits = Limits(candidates.cells, times, np.ones(80, bool), seconds=3e4, repeats=25, present=present)

    def duration(taken):
        planned = schedule(candidates.cells, in_order(candidates.cells, taken, present), times, start)
        return planned.end_s - len(start) * (times.dwell_s + times.settle_s)

    assert limits.duration_s(cells) == pytest.approx(duration(cells))
    longer = np.array([duration([*cells, k]) for k in range(80)])
    within = replace(limits, seconds=float(np.median(longer)))
    assert within.fits(cells).tolist() == (longer <= within.seconds + 1e-6).tolist()


def test_a_parameter_that_no_plan_determines_is_named_and_left_out(candidates, model):
    """With the spindle level gravity never acts along x in the first mounting."""
    few = np.flatnonzero((candidates.cells.beta_deg == 0) & (np.array(candidates.cells.mounts) == "A"))
    level = replace(model, columns=model.columns[few])
    assert level.undetermined() == ("dK_x", "gamma_21", "gamma_31") and not model.undetermined()
    every = of_parameters("largest", candidates)
    rows = determined(every.parts[0].rows, level)
    sure = Criterion("sure", (Part(rows, "largest"),))
    assert len(rows) == 6
    assert sure.of(level.covariance(range(8))) < 1.0 < every.of(level.covariance(range(8)))
    with pytest.raises(InputError, match="no plan on this head determines dK_x, gamma_21, gamma_31"):
        determined(np.eye(9)[:1], level)
