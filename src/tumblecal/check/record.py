"""`check.json`: a check in numbers."""

from typing import Annotated, Literal

from tumblecal import __version__
from tumblecal.check.consistency import LEVEL
from tumblecal.check.sensitivity import POWER
from tumblecal.data.calibration_use import Use
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.ground.record import FileRecord, Quantity, ResultRecord, TextOrNull, at, by_name


OfSensor = Annotated[dict[str, float], by_name(SENSOR)]


class AttitudeRecord(ResultRecord):
    """Excess of gravity at an attitude, and its standard uncertainty."""

    name: str
    excess_g: float
    u_g: float


class GravityRecord(ResultRecord):
    """`LocalSize`."""

    ratio: float
    u: float
    words: str


class NoiseRecord(ResultRecord):
    """Noise of a position, and the factor and degrees of freedom that the test uses."""

    sd_g: float = at("noise.sd_g")
    words: str = at("noise.words")
    factor: float = at("test.noise_factor")
    dof: float = at("test.noise_dof")


class ConsistencyRecord(ResultRecord):
    """`Consistency`: the test of the calibration."""

    chi2: float
    dof: int
    p_value: float
    level: float = LEVEL
    rejected: bool


class RestRecord(ResultRecord):
    """Test whether the attitudes agree with each other."""

    chi2: float = at("rest_chi2")
    dof: int = at("rest_dof")
    p_value: float | None = at("rest_p")


class SensitivityRecord(ResultRecord):
    """`Sensitivity`."""

    probability: float = POWER
    limits: Annotated[dict[str, Quantity], by_name(SENSOR)] = at("limits_with_units")
    worst: OfSensor
    invisible: list[str]
    hidden: list[str] = at("hidden_together")


class ExplanationRecord(ResultRecord):
    """`Explanation`."""

    kind: str
    parameters: list[str]
    attitude: TextOrNull
    probability: float
    change: OfSensor
    u: OfSensor = at("sd")


class ChangeRecord(ResultRecord):
    """`Moved`."""

    named: list[str] = at("named.parameters", ())
    largest_g: float | None = at("change_g.0", None)
    largest_expanded_g: float | None = at("change_g.1", None)
    explanations: list[ExplanationRecord] = at("possible")
    attitudes_that_separate: list[str]


class UpdateRecord(ResultRecord):
    """`Update`."""

    change: OfSensor
    u: OfSensor = at("sd")
    p_value: float = at("before.p_value")


class CheckRecord(ResultRecord):
    """`check.json`: the attributes of a `CheckResult`, with those of its provenance, `update` and `text` (the verdict)."""

    schema_: Literal["tumblecal.check/1"] = "tumblecal.check/1"
    source: str = at("data.source")
    calibration: FileRecord
    recording: list[FileRecord]
    measured_utc: str | None
    tumblecal: str = __version__
    serial_number: str | None
    verdict: str = at("outcome")
    use: Use
    attitudes: list[AttitudeRecord]
    attitudes_known: bool
    temperature_degc: float | None = at("expected.degc")
    gravity: GravityRecord
    noise: NoiseRecord = at("result")
    test: ConsistencyRecord
    rest: RestRecord = at("test")
    sensitivity: SensitivityRecord
    change: ChangeRecord | None = at("moved")
    update: UpdateRecord | None
    text: str
