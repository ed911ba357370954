"""Texts, tables and assumptions of a designed plan, from records made by hand."""

from dataclasses import replace

import numpy as np
import pytest

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.plan import grid
from tumblecal.chain.rig import Rig
from tumblecal.design.candidates import Evaluated
from tumblecal.design.common_plans import Positions
from tumblecal.design.criteria.criterion import Criterion
from tumblecal.design.forecast.naming import Alias, EffectForecast, NamingForecast
from tumblecal.design.model.cells import Cells
from tumblecal.design.model.evaluation import Uncertainties
from tumblecal.design.model.responses import Responses, Setting
from tumblecal.design.model.schedule import Schedule
from tumblecal.design.order.best_order import Ordered
from tumblecal.design.plan import DesignedPlan
from tumblecal.design.positions.bounds import Bounds
from tumblecal.design.wanted import Wanted
from tumblecal.report.plan_assumptions import assumptions
from tumblecal.report.plan_files import capture_files
from tumblecal.report.plan_tables import named_table, practice_table, uncertainty_table
from tumblecal.report.plan_words import plan_lines


NAMES = ("dK_x", "bias_x")
CELLS = Cells(np.array([0.0, 90.0, 180.0, 0.0]), np.array([0.0, 0.0, 30.0, 0.0]), ("A", "A", "A", "B"))
SCHEDULE = Schedule(
    np.arange(4), np.array([10.0, 95.0, 300.0, 2200.0]), 2260.0, np.array([0, 0, 1, 2]), np.array([0, 0, 0, 1])
)


def evaluated(name, sd, **further):
    sizes = np.array(sd) * 1e-3
    found = Uncertainties(NAMES, np.full(2, 1e-3), sizes, np.diag(np.array(sd) ** 2))
    use = np.array([[1e-4, 1e-4, 1e-4], [2e-4, 1e-4, 1e-4]])
    return Evaluated(Positions(name, "", (), (), ()), SCHEDULE, found, use, **further)


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
        criterion=Criterion("worst", np.eye(2), "largest"),
        ordered=Ordered(SCHEDULE, 0.2, 0.1998),
        bounds=Bounds(0.18, 0.19, 0.2, np.zeros(4), (), "whole positions: ...", 0.18),
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
        traded=(),
        forecast=predicted,
        units={},
    )


def test_the_lines_state_the_findings_first(plan):
    assert list(plan_lines(plan))[:10] == [
        "4 positions in 2 mountings, 38 min: largest standard uncertainty 0.20e-3 (dK_x)",
        "The plan of the rig file (4 positions, 38 min): largest standard uncertainty 0.80e-3 (dK_x); 4 times larger",
        "Efficiency: 90 % of the bound under white noise (any plan in these limits); 99.9 % of the bound with known slow noise "
        "(same visits)",
        "Distance to the bound: whole positions: ...",
        "Standard uncertainty of the corrected force in use: 0.12 mg (root mean square over attitudes and axes), at most "
        "0.20 mg",
        "second_order.z of 0.5 mg/g^2: named with probability 0.85, identified with probability 0.30; smallest size named with "
        "probability 0.8: 0.45 mg/g^2, identified: at no size; identical at 1 g: cross_axis_square.z; indistinguishable from "
        "warm_up",
        "Undetectable with these positions: gravity_value (plan of the rig file: 2 effects)",
        "Largest error in use from an effect at its detection limit: 1 mg (cross_coupling.x.xy of 2 mg/g^2)",
        "Best common practice in the same time: 4 x 12, largest standard uncertainty 0.40e-3 (dK_x); 2 times larger",
        "Assumed: criterion: the largest standard uncertainty of the sensor's parameters. Override with --criterion in_use",
    ]


def test_measured_positions_and_plans_without_a_forecast(plan):
    added = replace(plan, measured=2, forecast=None, bounds=None, after=replace(plan.after, effects=()))
    lines = list(plan_lines(added))
    assert lines[0] == "2 further positions in 2 mountings, 33 min: largest standard uncertainty 0.20e-3 (dK_x)"
    assert lines[1].startswith("The positions measured already (4 positions, 38 min): ")
    assert lines[2] == "Efficiency of the order: 99.9 % of the bound with known slow noise (same visits)"
    assert not any("Undetectable" in line for line in lines)
    assert capture_files(added) == {"plan_A.toml": [2], "plan_B.toml": [3]}


def test_tables_show_undetermined_parameters_and_plans_that_are_too_long(plan):
    assert uncertainty_table(plan).rows[0] == ["dK_x", "0.80", "0.20", "1e-3", "4"]
    practice = practice_table(plan, short=True).rows
    assert practice[1] == ["six positions", "4", "38", "not determined", "dK_x", "", "", "1"]
    assert practice[3][:5] == ["random", "4", "38 (too long)", "0.10e-3", "dK_x"]
    assert [row[1:] for row in named_table(plan).rows[:3]] == [["0.85", "0.45"], ["0.10", "0.45"], ["0.85", "none"]]


def test_assumptions_name_the_keys_that_override_them(plan):
    assert [each.override for each in assumptions(plan)] == [
        "--criterion in_use", "[head.times]", "[head.repeatability] pitch", "[head.noise]", "[noise] sd",
    ]  # fmt: skip
    words = {each.override: each.words for each in assumptions(plan)}
    assert words["[head.times]"] == "times: turn of the spindle 15 s"
    assert "independent error, standard deviation 0.344 arcmin" in words["[head.repeatability] pitch"]
