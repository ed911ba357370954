"""The forecast of a diagnosis against the diagnosis' own search and against least squares in numpy."""

from dataclasses import replace

import numpy as np
import pytest

import tumblecal
from few_effects import few_entries
from tumblecal.diagnosis.detection.alternatives import alternatives
from tumblecal.diagnosis.detection.detect import detect
from tumblecal.diagnosis.screening.screen import Screening
from tumblecal.diagnosis.sets.explanation import verdict_of
from tumblecal.diagnosis.sets.search import Search
from tumblecal.effects import catalogue
from tumblecal.ground.errors import InputError
from tumblecal.plan.forecast.decisions import decisions
from tumblecal.plan.forecast.effects_of_plan import ATTITUDES, effects_of_plan
from tumblecal.plan.forecast.naming import forecast_of


EFFECT, DRAWS = "second_order.z", 16


@pytest.fixture(scope="module")
def plan():
    return effects_of_plan(tumblecal.read_rig("remount"), few_entries())


@pytest.fixture(scope="module")
def forecast(plan):
    return forecast_of(plan, {EFFECT: 0.6}, draws=120)


def test_decisions_are_those_of_the_diagnosis(plan):
    """The same residual vectors by the search of the diagnosis, one by one."""
    noise = np.random.default_rng(1).standard_normal((DRAWS, plan.pool.dof))
    sizes = np.linspace(0.2, 1.2, DRAWS)[:, None]
    z = noise + sizes * plan.shown(EFFECT)
    found = np.array(decisions(plan, EFFECT, z)).T
    screening = Screening(plan.model)
    expected = np.zeros((DRAWS, 3), bool)
    for row, one in enumerate(z):
        at = replace(plan.at, residual=plan.at.basis @ one)
        others = alternatives(at, plan.pool.effect_blocks)
        detection = detect(at, plan.pool, others)
        if not detection.detected:
            continue
        search = Search(plan.pool, at.z, True)
        best = screening._explained(at, plan.pool, others, detection, search).best
        named = {id for labels in (best.labels, *best.equivalents) for id in labels}
        right = best.labels == (EFFECT,) or (EFFECT,) in best.identical
        expected[row] = True, EFFECT in named, right and verdict_of(best, False, False, False) == "identified"
    assert 2 <= np.sum(expected[:, 2]) < np.sum(expected[:, 0]) < DRAWS
    assert np.sum(found != expected) <= 1


def test_sizes_with_probability_0_8(plan, forecast):
    (own,) = forecast.effects
    assert own.unit == "mg/g^2"
    assert own.detection_limit <= own.smallest_named < own.smallest_identified
    noise = np.random.default_rng(7).standard_normal((400, plan.pool.dof))
    for number, size in enumerate((own.detection_limit, own.smallest_named, own.smallest_identified)):
        rate = np.mean(decisions(plan, EFFECT, noise + size * plan.shown(EFFECT))[number])
        assert rate == pytest.approx(0.8, abs=0.11)  # three standard deviations of 120 draws


@pytest.mark.long
def test_two_mountings_show_every_effect_of_second_and_third_order():
    whole = forecast_of(effects_of_plan(tumblecal.read_rig("remount"), catalogue()), {EFFECT: 0.6}, draws=120)
    assert "cross_axis_square.z" in whole.effects[0].identical
    assert {id for id in whole.undetectable if id.startswith(("second", "third", "cross", "scale"))} == set()
    assert "gravity_value" in whole.undetectable  # the same as three equal scale factor errors


def test_error_in_use_is_that_of_a_fit_without_the_effect(plan):
    """Exact readings of a plan with a quadratic term, fitted by least squares in numpy."""
    where, size = plan.at.problem.where, 1e-3
    chain = plan.model.nominal_chain
    inputs = plan.at.evaluation.inputs
    rows = np.asarray(plan.at.evaluation.jacobian)[:, :, : plan.model.nominal].reshape(-1, plan.model.nominal)
    added = np.zeros_like(inputs)
    added[:, 2] = size * inputs[:, 2] ** 2
    shift = np.linalg.lstsq(rows, added.ravel(), rcond=1e-12)[0] * plan.model.scales[: plan.model.nominal]
    moved = dict(zip(plan.model.names, shift, strict=True))
    assert len(np.asarray(where.alpha)) == 48
    assert len(chain.names) == len(shift)
    error = np.zeros((len(ATTITUDES), 3))
    error[:, 2] = size * ATTITUDES[:, 2] ** 2
    for axis, name in enumerate("xyz"):
        error[:, axis] -= moved[f"bias_{name}"] + moved[f"dK_{name}"] * ATTITUDES[:, axis]
    error[:, 1] -= moved["gamma_21"] * ATTITUDES[:, 0]
    error[:, 2] -= moved["gamma_31"] * ATTITUDES[:, 0] + moved["gamma_32"] * ATTITUDES[:, 1]
    assert plan.error_in_use(EFFECT) == pytest.approx(error.ravel(), abs=1e-9)


def test_effects_that_cannot_be_forecast(plan):
    with pytest.raises(
        InputError, match=r"bias_drift\.x: a plan cannot be designed for it: the data have no column time_s"
    ):
        forecast_of(plan, {"bias_drift.x": 1.0})
    with pytest.raises(InputError, match=r"no effect 'second_ordr\.x'"):
        forecast_of(plan, {"second_ordr.x": 1.0})
    with pytest.raises(InputError, match="a size above 0"):
        forecast_of(plan, {EFFECT: 0.0})
