"""What a dividing head can do, as stated in the `[head]` table of a rig file: settings, times, repeatability, slow noise."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field, model_validator

from tumblecal.chain.plan_table import Angles, Steps
from tumblecal.ground.strict_toml import Angle, Force, ForceRate, Line, Number, Strict


@dataclass(frozen=True)
class Times:
    """Times, s: of a dwell, of settling before it, of a turn of the spindle, a change of the pitch setting, of the mounting
    and of the temperature."""

    dwell_s: float = 60.0
    settle_s: float = 10.0
    turn_s: float = 15.0
    pitch_change_s: float = 120.0
    remount_s: float = 1800.0
    temperature_change_s: float = 7200.0


@dataclass(frozen=True)
class Repeatability:
    """Standard deviation of a pitch setting and of a mounting when it is set again, rad; None: not stated."""

    pitch: float | None = None
    mount: float | None = None


@dataclass(frozen=True)
class SlowNoise:
    """Parts of the noise that are common to neighbouring dwells, on each axis: bias instability (flicker), g; random walk,
    g/sqrt(s); an exponentially correlated part, g, with its correlation time, s; standard deviation of a linear drift, g/h,
    and of an exponential warm-up, g, with its time constant, s."""

    bias_instability_g: float = 0.0
    random_walk_g_per_rts: float = 0.0
    markov_sd_g: float = 0.0
    markov_time_s: float = 1000.0
    drift_g_per_h: float = 0.0
    warm_up_g: float = 0.0
    warm_up_time_s: float = 1800.0

    @property
    def any(self) -> bool:
        """Whether there is such a part."""
        stationary = max(self.bias_instability_g, self.random_walk_g_per_rts, self.markov_sd_g)
        return max(stationary, self.drift_g_per_h, self.warm_up_g) > 0


@dataclass(frozen=True)
class HeadAbility:
    """What a dividing head can do.

    - `alpha_deg`, `beta_deg`: spindle angles and pitch settings that can be set.
    - `mounts`: possible mountings, by their labels in `[mounts]`. `temperatures_degc`: of the chamber; empty: no chamber.
    - `slow_noise`: in addition to the white noise of a dwell (`[noise] sd`).
    - `assumed`: keys of the table that the file does not state: `times.turn_s`, `repeatability.pitch`.
    """

    alpha_deg: tuple[float, ...]
    beta_deg: tuple[float, ...]
    mounts: tuple[str, ...] = ("1",)
    temperatures_degc: tuple[float, ...] = ()
    times: Times = Times()
    repeatability: Repeatability = Repeatability()
    slow_noise: SlowNoise = SlowNoise()
    assumed: tuple[str, ...] = ()


NotNegative = Annotated[Number, Field(ge=0)]


class TimesTable(Strict):
    """The `[head.times]` table, s."""

    dwell_s: Annotated[Number, Field(gt=0)] = Times.dwell_s
    settle_s: NotNegative = Times.settle_s
    turn_s: NotNegative = Times.turn_s
    pitch_change_s: NotNegative = Times.pitch_change_s
    remount_s: NotNegative = Times.remount_s
    temperature_change_s: NotNegative = Times.temperature_change_s


class RepeatabilityTable(Strict):
    """The `[head.repeatability]` table: standard deviation of a setting that is set again."""

    pitch: Angle | None = None
    mount: Angle | None = None


class SlowNoiseTable(Strict):
    """The `[head.noise]` table: parts of the noise that are common to neighbouring dwells."""

    bias_instability: Force = 0.0
    random_walk_g_per_rts: Annotated[Number, Field(ge=0)] = 0.0
    markov_sd: Force = 0.0
    markov_time_s: Annotated[Number, Field(gt=0)] = SlowNoise.markov_time_s
    drift: ForceRate = 0.0
    warm_up: Force = 0.0
    warm_up_time_s: Annotated[Number, Field(gt=0)] = SlowNoise.warm_up_time_s

    def slow_noise(self) -> SlowNoise:
        """The parts."""
        return SlowNoise(*(float(value) for _, value in self))


class HeadAbilityTable(Strict):
    """The `[head]` table of a rig file."""

    alpha_deg: Angles = Field(default_factory=lambda: Steps(start=0, step=15, count=24))
    beta_deg: Angles | None = None
    mounts: Annotated[list[Line], Field(min_length=1)] | None = None
    temperatures_degc: Annotated[list[Number], Field(default_factory=list)]
    times: TimesTable = TimesTable()
    repeatability: RepeatabilityTable = RepeatabilityTable()
    noise: SlowNoiseTable = SlowNoiseTable()

    @model_validator(mode="after")
    def _distinct(self) -> "HeadAbilityTable":
        for name in ("alpha_deg", "beta_deg", "mounts", "temperatures_degc"):
            listed = _values(getattr(self, name))
            if len(set(listed)) < len(listed):
                raise ValueError(f"{name}: a value is listed twice; list each once")
        if self.alpha_deg is not None and not _values(self.alpha_deg):
            raise ValueError("alpha_deg is empty; list the spindle angles that can be set")
        if any(abs(angle) > 90 for angle in _values(self.beta_deg)):
            raise ValueError("beta_deg: pitch settings are from -90 to 90 deg")
        return self

    def ability(self, beta_deg: tuple[float, ...], mounts: tuple[str, ...]) -> HeadAbility:
        """What the head can do; `beta_deg`, `mounts`: of the rig's plan, if the table states none."""
        return HeadAbility(
            alpha_deg=tuple(float(angle) for angle in _values(self.alpha_deg)),
            beta_deg=tuple(float(angle) for angle in _values(self.beta_deg)) or beta_deg,
            mounts=tuple(self.mounts or mounts),
            temperatures_degc=tuple(float(degc) for degc in self.temperatures_degc),
            times=Times(**self.times.model_dump()),
            repeatability=Repeatability(self.repeatability.pitch, self.repeatability.mount),
            slow_noise=self.noise.slow_noise(),
            assumed=tuple(self._assumed()),
        )

    def _assumed(self) -> Iterator[str]:
        for name, table in (("", self), ("times.", self.times), ("repeatability.", self.repeatability)):
            tables = {"times", "repeatability", "noise"} if table is self else set[str]()
            unstated = type(table).model_fields.keys() - table.model_fields_set - tables
            yield from sorted(name + key for key in unstated)
        if not self.noise.slow_noise().any:
            yield "noise"


def _values(listed: "list | Steps | None") -> list:
    return listed.values if isinstance(listed, Steps) else listed or []
