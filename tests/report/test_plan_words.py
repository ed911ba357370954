"""Texts and tables of a designed plan, from records made by hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.plan import grid
from tumblecal.chain.rig import Rig
from tumblecal.plan.bound import Bounds
from tumblecal.plan.cells import Cells, Positions
from tumblecal.plan.criterion import Criterion, Part
from tumblecal.plan.designed_plan import DesignedPlan, Evaluated, Found
from tumblecal.plan.forecast.record import Alias, EffectForecast, NamingForecast
from tumblecal.plan.information import Uncertainties
from tumblecal.plan.limits import Schedule
from tumblecal.plan.order import Ordered
from tumblecal.plan.plan_files import capture_files
from tumblecal.plan.request import Wanted
from tumblecal.plan.responses import Responses, Setting
from tumblecal.show.plan import plan_lines, words_of_plan


NAMES = ("dK_x", "bias_x")
CELLS = Cells(np.array([0.0, 90.0, 180.0, 0.0]), np.array([0.0, 0.0, 30.0, 0.0]), ("A", "A", "A", "B"))
SCHEDULE = Schedule(
    np.arange(4), np.array([10.0, 95.0, 300.0, 2200.0]), 2260.0, np.array([0, 0, 1, 2]), np.array([0, 0, 0, 1])
)


def evaluated(name, sd, **further):
    sizes = np.array(sd) * 1e-3
    found = Uncertainties(NAMES, np.full(2, 1e-3), sizes, np.diag(np.array(sd) ** 2))
    use = np.array([[1e-4, 1e-4, 1e-4], [2e-4, 1e-4, 1e-4]])
    return Evaluated(Positions(name, "", CELLS), SCHEDULE, found, use, compared=NAMES, **further)


@pytest.fixture
def plan():
    setting = Setting(np.zeros((4, 3, 1)), 0.0, 0.1, 1e-3)
    named = EffectForecast(
        "second_order.z", "mg/g^2", 0.5, 0.6, 0.9, 0.85, 0.3, 0.4, 0.45, None, ("cross_axis_square.z",), ("warm_up",)
    )
    predicted = NamingForecast(
        (named,), {}, ("gravity_value",), Alias("cross_coupling.x.xy", 2.0, "mg/g^2", 1e-3), None, 500, {}
    )
    ability = HeadAbility(
        (0.0, 90.0), (0.0, 30.0), ("A", "B"), assumed=("times.turn_s", "repeatability.pitch", "noise")
    )
    return DesignedPlan(
        rig=Rig("head", grid([0, 90], [0, 30]), source="head.toml"),
        ability=ability,
        wanted=Wanted(positions=4),
        responses=Responses(
            CELLS, NAMES, np.full(2, 1e-3), np.zeros((4, 3, 2)), np.zeros((2, 2)), setting, setting, 1e-4
        ),
        names=("1", "2", "3", "4"),
        measured=0,
        found=Found(
            Criterion("worst", (Part(np.eye(2), "largest"),)),
            Ordered(SCHEDULE, 0.2, 0.1998),
            Bounds(0.18, 0.19, 0.2, 0.18, "whole positions: ..."),
            (),
        ),
        after=evaluated("this plan", [0.2, 0.1], effects=(named,), undetectable=("gravity_value",)),
        before=evaluated(
            "plan of the rig file", [0.8, 0.1], undetectable=("a", "b"), effects=(replace(named, named=0.1),)
        ),
        practice=(
            evaluated(
                "six positions", [np.inf, 0.1], undetectable=("a",), effects=(replace(named, smallest_named=None),)
            ),
            evaluated("4 x 12", [0.4, 0.1], effects=(named,)),
            evaluated("random", [0.1, 0.1], fits=False, effects=(named,)),
        ),
        forecast=predicted,
    )


def test_lines_and_tables_of_a_plan(plan, snapshot):
    found, after = replace(plan.found, bounds=None), replace(plan.after, effects=())
    added = replace(plan, measured=2, forecast=None, found=found, after=after)
    words, of_added = (words_of_plan(each, Path("plan")) for each in (plan, added))
    tables = (words.blocks[name] for name in ("positions", "uncertainties", "practice", "effects", "named"))
    texts = {
        "plan": "\n".join([*plan_lines(words), *words.lines("next")]),
        "measured positions, no forecast": "\n".join(plan_lines(of_added)),
        "tables": "\n\n".join("\n".join(" | ".join(row) for row in rows) for rows in tables),
    }
    snapshot("plan", texts)
    assert capture_files(added) == {"plan_A.toml": [2], "plan_B.toml": [3]}
