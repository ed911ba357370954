"""The next measurement in words, from plans made by hand: what to measure, why, and what it settles."""

from types import SimpleNamespace as Record

from tumblecal.diagnosis.findings.factors import Factor, Reason
from tumblecal.plan.next.conditions import Conditions
from tumblecal.plan.next.next_plan import SEPARATE, SHARPEN, SHARPEN_WEAKEST, Confirmation
from tumblecal.plan.next.proposals import SAMPLE, NextPosition
from tumblecal.plan.next.separating import Promise
from tumblecal.planning import NextPlan
from tumblecal.show.next_plan import next_words


DRIFT, WARM, SQUARE, CROSS = ("bias_drift.x",), ("bias_temperature.x",), ("second_order.z",), ("cross_axis_square.z",)
FACTORS = (
    Factor((DRIFT, WARM), (Reason("columns", ("time", "temperature"), 1.0),)),
    Factor((SQUARE, CROSS), (Reason("identity"),)),
)
NUMBERS = {DRIFT[0]: 1, SQUARE[0]: 2}
POSITIONS = (
    NextPosition(225.0, 0.0, "", "", 3.0),
    NextPosition(0.0, 0.0, "", "", 2.0),
    NextPosition(0.0, 30.0, "turned 90 deg about z", "", 1.0, turn_deg=(0.0, 90.0, 180.0, 270.0)),
)
LATER = Conditions(600.0, 2100.0, 60.0, 26.46, 26.5, "1")
ELSEWHERE = Conditions(86_400.0, 90_000.0, 60.0, 21.0, 26.5, "2")


def promise(odds, remaining=(), probability=0.93):
    return Promise(probability, probability, odds, (WARM,), remaining)


def words(plan):
    diagnosis = Record(factors=FACTORS if plan.promise is not None else ())
    return "\n".join(next_words(diagnosis, plan, None, NUMBERS))


def test_each_kind_of_plan_is_a_text(snapshot):
    plans = {
        "separate, settled": NextPlan((), POSITIONS, SEPARATE, 3.0, conditions=LATER, promise=promise(2e6)),
        "separate, not all": NextPlan(
            (), POSITIONS[:1], SEPARATE, 3.0, conditions=ELSEWHERE, promise=promise(40.0, (WARM, (*WARM, *SQUARE)), 0.6)
        ),
        "not worth it": NextPlan((), POSITIONS[:2], SHARPEN, 0.31, "bias_x", promise=promise(4.2)),
        "nothing separates them": NextPlan(promise=promise(1.4), notes=("No mounting is allowed.",)),
        "weakest direction": NextPlan(
            (),
            (NextPosition(0.0, 0.0, "", "", 0.2, direction="+z up, tilted 30 deg towards +x"),),
            SHARPEN_WEAKEST,
            0.42,
        ),
        "the error itself": NextPlan((), POSITIONS[:2], SAMPLE, 8.0, in_reverse=True),
        "confirm": NextPlan(
            confirming=(Confirmation(75.0, 60.0, "x", -0.86298, -0.86359, 1.1e-4, 1.3e-4, DRIFT + CROSS),)
        ),
    }
    snapshot("next", {title: words(plan) for title, plan in plans.items()})


def test_the_number_of_positions_counts_each_angle_of_a_turn():
    assert NextPlan((), POSITIONS).positions == 6 and "6 positions, 15 min in all" in words(
        NextPlan((), POSITIONS, SHARPEN, 0.3, "bias_x", conditions=LATER)
    )
