"""`reduction.json`: a reduction in numbers."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, ConfigDict

from tumblecal.ground.axes import AXES
from tumblecal.ground.record import Count, ResultRecord, at
from tumblecal.noise.dwell_sd import batch_means_sd, white_sd
from tumblecal.recordings.dwells.dwell_checks import DwellChecks


class AllanRecord(ResultRecord):
    """`AllanDeviation`, g."""

    tau_s: list[float]
    deviation_g: list[float] = at("deviation")
    low_g: list[float] = at("low")
    high_g: list[float] = at("high")


class AxisRecord(ResultRecord):
    """Noise coefficients of an axis, and its Allan deviation."""

    noise: dict[str, float]
    allan: AllanRecord = at("result")


class WithinDwellsRecord(ResultRecord):
    """`WithinDwells`."""

    variable: str
    axes: Annotated[
        list[str], BeforeValidator(lambda shows: [axis for axis, each in zip(AXES, shows, strict=True) if each])
    ]
    bias_g_per_unit: list[float] = at("bias")
    scale_per_unit: list[float] = at("scale")
    p_value: list[float]
    largest_change_g: list[float] = at("change")
    dwells: int
    largest_course: float = at("course")
    confounded: bool
    words: Annotated[str, BeforeValidator(lambda words: words())]


class PositionRecord(ResultRecord):
    """A position: its mean and the standard deviations of the mean, by the noise and by two other estimates from its samples,
    with further entries of its source."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="allow")

    name: str
    n: int
    mean_g: list[float]
    sd_of_mean_g: list[float]
    batch_means_sd_g: Annotated[list[float], BeforeValidator(batch_means_sd)]
    white_noise_sd_g: Annotated[list[float], BeforeValidator(white_sd)]
    checks: DwellChecks


class IntervalRecord(ResultRecord):
    """An `Interval` at rest; `used`: whether it has no `reason` against it."""

    start: int
    stop: int
    start_s: float
    stop_s: float
    mean: list[float]
    knocks: list[tuple[int, int]]
    reason: str
    used: bool


class StillRecord(ResultRecord):
    """How the intervals of a `Stillness` were found: criterion, noise of a sample, steps of the readings."""

    false_alarm: float = at("criterion.false_alarm")
    least_s: float = at("criterion.least_s")
    guard_s: float = at("criterion.guard_s")
    noise: list[float]
    dof: list[float]
    coarse_steps: dict[str, float] = at("coarse")
    joins: int
    size_judged: bool


class AtRestRecord(ResultRecord):
    """A `Stillness`."""

    still: StillRecord = at("result")
    intervals: list[IntervalRecord]


class MatchRecord(ResultRecord):
    """A `PlanMatch`: positions without an interval, and with several; number of intervals that are no position."""

    missing: list[str]
    repeated: list[str]
    surplus: Count
    in_order: bool


class ReductionRecord(ResultRecord):
    """`reduction.json`: a `Reduction`, with further entries of its source."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="allow")

    schema_: Literal["tumblecal.reduction/1"] = "tumblecal.reduction/1"
    rate_hz: float
    noise_model: dict[str, Any]
    within_dwells: list[WithinDwellsRecord]
    axes: dict[str, AxisRecord]
    positions: list[PositionRecord]
