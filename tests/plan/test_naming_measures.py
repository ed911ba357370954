"""Criteria of naming and alias against projections in numpy, and their steps against values made from scratch."""

import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tumblecal.chain.rig_file import rig_of
from tumblecal.effects import catalogue
from tumblecal.effects.catalogue import links_and_units
from tumblecal.ground.errors import InputError
from tumblecal.plan.cells import cells_of
from tumblecal.plan.effect_criteria import TERMS
from tumblecal.plan.exchange import Selection
from tumblecal.plan.forecast.effects_of_plan import ATTITUDES, effects_of_cells
from tumblecal.plan.forecast.naming import hidden_on_head
from tumblecal.plan.responses import responses_of


RIG = """
schema = "tumblecal.rig/1"
[plan]
alpha_deg = { start = 0, step = 45, count = 8 }
beta_deg = [0, 45, 90]
mounts = ["A", "B"]
[chain.leaves]
dbeta = { by = "mount.pitch", free = false }
dtheta = { by = "mount", free = false }
[mounts]
A = { rotation_deg = [0, 0, 0] }
B = { rotation_deg = [0, 0, 90] }
[noise]
sd = "0.1 mg"
[head]
alpha_deg = { start = 0, step = 45, count = 8 }
"""
SD = 1e-4
EFFECTS = ("gravity_value", "memory.x", "scale_asymmetry.x", "scale_asymmetry.z", "second_order.z", "third_order.x")


@pytest.fixture(scope="module")
def head():
    entries = {id: effect for id, effect in catalogue().items() if id in EFFECTS}
    rig = rig_of(tomllib.loads(RIG), Path("rig.toml"), *links_and_units(entries))
    cells = cells_of(rig.ability)
    return SimpleNamespace(
        rig=rig,
        entries=entries,
        responses=responses_of(rig, cells),
        effects=effects_of_cells(rig, cells, entries, 3600.0),
    )


def _term(head, kind, effects):
    return TERMS[kind](head.effects, head.responses, np.zeros(0, int), effects)


def _values(term, cells):
    return [float(criterion.of(model.covariance(cells))) for model, criterion in term.criteria]


@pytest.fixture(scope="module")
def cells(head):
    return np.random.default_rng(5).permutation(len(head.responses.cells))[:20]


def _inputs(head):
    """Forces on the axes of the sensor, g, from the frames of the documentation, in numpy."""
    cells = head.responses.cells
    alpha, beta = np.radians(cells.alpha_deg), np.radians(cells.beta_deg)
    f = np.stack([-np.sin(beta), np.cos(beta) * np.sin(alpha), np.cos(beta) * np.cos(alpha)], axis=1)
    turned = np.stack([f[:, 1], -f[:, 0], f[:, 2]], axis=1)
    return np.where(np.array([mount == "B" for mount in cells.mounts])[:, None], turned, f)


def _nominal(u):
    """Readings of one axis by bias, scale and two misalignments: of z, all of the sensor's parameters that it has."""
    return np.column_stack([np.ones(len(u)), u])


@pytest.mark.long
def test_smallest_size_that_is_named(head, cells):
    """second_order.z: the largest of what detection and each separation need."""
    term = _term(head, "naming", {"second_order.z": 0.5})
    needed = _values(term, cells)
    u = _inputs(head)[cells]
    square = u[:, 2] ** 2 * 1e-3 / SD  # of 1 mg/g^2, in noise sd

    def left(columns):
        columns = np.column_stack([_nominal(u), *columns])
        return np.linalg.norm(square - columns @ np.linalg.lstsq(columns, square, rcond=None)[0])

    detection = needed[0] * 0.5 * left([])
    assert 4.0 < detection < 5.0
    separation = 0.8416 + np.sqrt(0.8416**2 + 2 * np.log(4))
    values = [one * 0.5 / separation for one in needed[1:]]
    assert 1 / left([np.abs(u[:, 2])]) == pytest.approx(
        min(values, key=lambda one: abs(one * left([np.abs(u[:, 2])]) - 1)), rel=1e-3
    )
    assert Selection(None, [term], cells).value == pytest.approx(max(needed))


def test_largest_error_in_use_at_the_detection_limit(head, cells):
    value = Selection(None, [_term(head, "alias", {"second_order.z": 1.0})], cells).value
    detected = _values(_term(head, "naming", {"second_order.z": 1.0}), cells)[0]  # mg/g^2
    u = _inputs(head)[cells]
    fitted = np.linalg.lstsq(_nominal(u), u[:, 2] ** 2, rcond=None)[0]
    error = ATTITUDES[:, 2] ** 2 - _nominal(ATTITUDES) @ fitted
    assert value == pytest.approx(detected * np.max(np.abs(error)), rel=1e-3)


@pytest.mark.parametrize("kind", ["naming", "alias"])
def test_steps_are_those_of_new_measures(head, cells, kind):
    effects = {"third_order.x": 1.0}
    term = _term(head, kind, effects)
    value = Selection(None, [term], cells)
    added, removed = value.if_changed(np.arange(8), 1), value.if_changed(cells, -1)
    assert added[7] == pytest.approx(Selection(None, [term], [*cells, 7]).value, rel=1e-8)
    assert removed[3] == pytest.approx(Selection(None, [term], np.delete(cells, 3)).value, rel=1e-8)
    value.add(7)
    value.add(int(cells[3]), -1)
    assert value.cells == [*np.delete(cells, 3), 7]
    assert value.value == pytest.approx(Selection(None, [term], value.cells).value, rel=1e-8)


def test_effects_that_positions_cannot_show(head):
    assert hidden_on_head(head.rig, ("gravity_value", "second_order.z"), head.entries) == ("gravity_value",)
    with pytest.raises(InputError, match="gravity_value: no positions of this head show it"):
        _term(head, "naming", {"gravity_value": 1.0})
    with pytest.raises(InputError, match="depends on the position before"):
        _term(head, "naming", {"memory.x": 1.0})
