"""Measured positions against a designed plan: each kind of difference is one line, and none is an empty list."""

from dataclasses import replace

import numpy as np
import pytest

from tumblecal.chain.plan import Plan
from tumblecal.chain.rig import Rig
from tumblecal.data import PositionSet
from tumblecal.estimation.planned_positions import compared_with_plan


# Two mountings with two positions each.
NAMES, ALPHA, BETA, MOUNTS = ("1", "2", "3", "4"), (0.0, 345.0, 90.0, 180.0), (0.0, 0.0, 30.0, 30.0), tuple("AABB")


@pytest.fixture
def rig():
    return Rig("", Plan(NAMES, ALPHA, BETA, MOUNTS, ("1",) * 4, time_s=(0.0, 60.0, 120.0, 180.0)), source="rig.toml")


def measured(rows):
    return PositionSet(
        tuple(NAMES[k] for k in rows),
        np.array([ALPHA[k] for k in rows]),
        np.array([BETA[k] for k in rows]),
        np.tile([0.0, 0.0, 1.0], (len(rows), 1)),
        mount=tuple(MOUNTS[k] for k in rows),
    )


def test_positions_that_differ_are_one_line_for_each_kind(rig):
    turned = measured([3, 1, 0, 2])
    assert compared_with_plan(rig, turned) == []
    assert compared_with_plan(rig, replace(turned, alpha_deg=turned.alpha_deg - 360.0)) == []
    lines = compared_with_plan(rig, measured([0, 0, 2]))
    assert len(lines) == 2
    assert lines[0].startswith("2 positions of 4 in rig.toml not measured (A 2, B 4)")
    assert lines[1].startswith("1 position of rig.toml measured more than once (A 1)")
    (line,) = compared_with_plan(rig, measured([0, 1]))
    assert line.startswith("no position of mounting B, of 2 in rig.toml") and "--join" in line
    (line,) = compared_with_plan(rig, replace(measured([0, 1, 2, 3, 3]), names=(*NAMES, "mine")))
    assert line.startswith("1 position not in rig.toml (B mine)")


@pytest.mark.parametrize("change", [{"alpha_deg": np.array([0.0, 15.0, 90.0, 180.0])}, {"names": tuple("wxyz")}])
def test_the_rig_of_a_different_plan_is_named(rig, change):
    (line,) = compared_with_plan(rig, replace(measured([0, 1, 2, 3]), **change))
    assert "the rig of a different plan" in line
