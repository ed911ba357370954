"""`plan.json`: a designed plan in numbers."""

from typing import Annotated, Literal

from pydantic import BeforeValidator

from tumblecal.ground.record import Count, ResultRecord, TextOrNull, at, by_name
from tumblecal.plan.designed_plan import InUse, TradeOff, Worst
from tumblecal.plan.forecast.record import Alias, EffectForecast, Limit


SCHEMA = "tumblecal.plan/1"
# From the number of the visit of each position.
Visits = Annotated[int, BeforeValidator(lambda visit: visit[-1] + 1)]


class PositionRecord(ResultRecord):
    """A position in measuring order."""

    name: str
    alpha_deg: float
    beta_deg: float
    mount: str
    temperature_degc: float | None = None
    start_s: float
    measured: bool


class ParameterRecord(ResultRecord):
    """Standard uncertainty of a parameter, by the plan and before it."""

    u: float
    u_before: float
    unit: str


class CriterionRecord(ResultRecord):
    """Value of the criterion and its lower bounds."""

    value: float = at("ordered.value")
    slow_noise_known: float = at("ordered.drift_known")
    bound_white: float | None = at("bounds.repeated", None)
    bound_one_visit: float | None = at("bounds.white", None)
    bound_of_positions: float | None = at("bounds.own", None)
    reason: TextOrNull = at("bounds.reason", None)


class ForecastRecord(ResultRecord):
    """`NamingForecast`."""

    draws: int
    detection_limits: dict[str, Limit]
    undetectable: list[str]
    hidden_on_head: list[str]
    not_testable: dict[str, str]
    alias: Alias | None
    alias_of_undetectable: Alias | None


class EvaluatedRecord(ResultRecord):
    """`Evaluated`."""

    name: str = at("positions.name")
    source: TextOrNull = at("positions.source")
    positions: Count = at("schedule")
    minutes: float = at("schedule.minutes")
    fits: bool
    deviation_deg: float = at("positions.deviation_deg")
    worst: Worst
    undetermined: list[str] = at("uncertainties.undetermined")
    in_use_g: InUse
    effects: list[EffectForecast]
    undetectable: list[str] | None


class AssumptionRecord(ResultRecord):
    """An assumption, and the option that overrides it."""

    words: str
    override: str


class PlanRecord(ResultRecord):
    """`plan.json`: a `DesignedPlan`, with `files` that were written, `words` that are printed, and `assumptions`."""

    schema_: Literal["tumblecal.plan/1"] = SCHEMA
    source: str = at("rig.source")
    files: list[str]
    positions: list[PositionRecord] = at("scheduled")
    minutes: float
    pitch_visits: Visits = at("after.schedule.pitch_visit")
    mount_visits: Visits = at("after.schedule.mount_visit")
    criteria: dict[str, float] = at("wanted.criteria")
    order: str = at("wanted.order")
    seed: int = at("wanted.seed")
    parameters: dict[str, ParameterRecord]
    in_use_g: InUse = at("after.in_use_g")
    criterion: CriterionRecord = at("found")
    effects: list[EffectForecast] = at("after.effects")
    forecast: ForecastRecord | None
    before: EvaluatedRecord
    practice: list[EvaluatedRecord]
    trade_off: list[TradeOff] = at("found.traded")
    assumptions: list[Annotated[AssumptionRecord, by_name(("words", "override"))]]
    words: list[str]
