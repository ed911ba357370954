"""Continuous angles: the uncertainties by the responses at the new angles, in the model of a search."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from tumblecal.chain.head_ability import Repeatability
from tumblecal.chain.nominal import Leaf
from tumblecal.design.common_plans import Positions
from tumblecal.design.criteria.criterion import mean, worst
from tumblecal.design.model.limits import in_order
from tumblecal.design.model.one_visit import one_visit
from tumblecal.design.model.responses import responses_of
from tumblecal.design.plan import design_plan
from tumblecal.design.positions.continuous import continuous_cells
from tumblecal.design.wanted import Wanted
from tumblecal.effects import catalogue
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head
from tumblecal.report.plan_words import plan_lines


def test_continuous_angles_reduce_the_criterion(head, candidates):
    ability = replace(head.ability, alpha_continuous=True)
    taken = in_order(candidates.cells, np.r_[8:12, 17:20, 24:28, 56:60, 65:68])
    criterion = worst(candidates)
    before = float(criterion.of(one_visit(candidates).covariance(taken)))
    moved = continuous_cells(head, candidates, ability, criterion, taken, steps=30)
    assert moved.beta_deg.tolist() == candidates.cells.beta_deg[taken].tolist()
    assert moved.mounts == candidates.cells.chosen(taken).mounts
    after = float(criterion.of(one_visit(responses_of(head, moved)).covariance(np.arange(len(taken)))))
    assert after < 0.98 * before
    with pytest.raises(InputError, match="neither alpha_continuous nor beta_continuous"):
        continuous_cells(head, candidates, head.ability, criterion, taken)


def test_the_angles_are_those_of_a_general_purpose_minimisation(head, candidates):
    """Bias, scale factors and non-orthogonality with exact settings, in plain numpy, by BFGS with numerical derivatives."""
    leaves = {name: Leaf(by, free=False) for name, by in (("dbeta", "mount.pitch"), ("dtheta", "mount"))}
    ability = replace(head.ability, alpha_continuous=True, repeatability=Repeatability(0.0, 0.0))
    rig = replace(head, leaves=leaves, priors={}, ability=ability)
    responses = responses_of(rig, candidates.cells)
    taken, criterion = in_order(candidates.cells, np.r_[8:12, 17:20, 24:27]), mean(responses)
    beta = np.radians(candidates.cells.beta_deg[taken])

    def value(alpha):
        force = gravity_in_head(alpha, beta)
        columns = np.zeros((len(taken), 3, 9))
        for axis in range(3):
            columns[:, axis, axis], columns[:, axis, 3 + axis] = force[:, axis], 1.0
        columns[:, 1, 6], columns[:, 2, 7], columns[:, 2, 8] = force[:, 0], force[:, 0], force[:, 1]
        rows = columns.reshape(-1, 9) / 0.15
        return np.sqrt(np.mean(np.diag(np.linalg.inv(rows.T @ rows))))

    begin = np.radians(candidates.cells.alpha_deg[taken])
    assert value(begin) == pytest.approx(float(criterion.of(one_visit(responses).covariance(taken))), rel=1e-4)
    moved = continuous_cells(rig, responses, ability, criterion, taken)
    expected = minimize(lambda alpha: np.log(value(alpha)), begin, method="BFGS").fun
    assert np.log(value(np.radians(moved.alpha_deg))) == pytest.approx(expected, abs=2e-3)
    assert expected < np.log(0.99 * value(begin))


def test_a_plan_uses_continuous_angles_and_keeps_measured_positions(head):
    ability = replace(head.ability, alpha_deg=(0.0, 90.0, 180.0, 270.0), alpha_continuous=True, beta_continuous=True)
    measured = Positions("measured.csv", "", (0.0, 90.0, 180.0), (0.0, 0.0, 45.0), ("A",) * 3)
    wanted = Wanted(positions=9, criteria={"mean": 1.0, "worst": 1.0}, restarts=1, order="keep", measured=measured)
    plan = design_plan(replace(head, ability=ability), replace(wanted, forecast=False), catalogue())
    assert plan.listed_angles is not None and plan.ordered.value < 0.999 * plan.listed_angles
    assert plan.cells.alpha_deg[:3].tolist() == [0.0, 90.0, 180.0]
    assert np.any(plan.cells.alpha_deg[3:] % 90 > 1) and np.max(np.abs(plan.cells.beta_deg)) <= 90
    assert len(set(plan.cells.beta_deg.tolist())) <= 5
    words = list(plan_lines(plan))
    assert any(line.startswith("Continuous angles: criterion weighted ") for line in words)
    assert any("(any plan in these limits at the listed angles)" in line for line in words)
