"""`diagnosis.json`: a diagnosis with the next measurement; angles in deg, readings in g."""

from tumblecal.diagnosis.record import DiagnosisRecord
from tumblecal.ground.record import ResultRecord, TextOrNull, at
from tumblecal.plan.next.next_plan import Confirmation
from tumblecal.plan.next.proposals import NextPosition
from tumblecal.plan.next.separating import Promise


class NextPlanRecord(ResultRecord):
    """`NextPlan`."""

    purpose: TextOrNull
    watched: TextOrNull
    in_reverse: bool
    value: float
    together: list[NextPosition]
    notes: list[str]
    confirming: list[Confirmation]


class ConditionsRecord(ResultRecord):
    """`Conditions`; `mounting`: how the triad is turned in its fixture, "" for the present mounting."""

    after_s: float | None
    time_s: float | None
    step_s: float
    temperature_degc: float | None
    last_temperature_degc: float | None
    run: str
    mounting: list[str]
    order: str = "as listed in the plan"


class NextRecord(ResultRecord):
    """Conditions of the next measurement, and its expected result."""

    conditions: ConditionsRecord | None = at("conditions_of_positions")
    promise: Promise | None


class DiagnosisWithPlanRecord(DiagnosisRecord):
    """`diagnosis.json`: a diagnosis with `plan`."""

    next_positions: list[NextPosition] = at("plan.singles")
    next_plan: NextPlanRecord = at("plan")
    next: NextRecord = at("plan")
