"""The plan of a capture: a TOML file with positions, temperatures, port, dwell time, and the data of the session."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import groupby, product
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, ValidationError, model_validator

from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head, rotation_matrix
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2, Gravity, normal_gravity
from tumblecal.ground.strict_toml import Line, Number, Strict, checked, read_toml


SETUP, OPERATOR = "capture_setup", "operator"
_MOST_POSITIONS = 5000
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Celsius = Annotated[Number, Field(ge=-200, le=400)]
# The rate of a temperature is determined over this fraction of the time for which it must be stable.
RATE_FRACTION = 0.2
# The next plan has different ones of these.
_NOT_COPIED = {"session": {"title", "mount", "run", "notes"}, "port": {"serial_number"}}
# The commands that read these two kinds of file: their contents in words, and the keys that no other kind has.
_KINDS = {
    "capture": (
        "the plan of a capture",
        ("session", "port", "positions", "dwell", "limits", "conditions", "soak"),
    ),
    "emulate": (
        "the description of a virtual instrument",
        ("instrument", "rig", "effects", "noise", "head", "temperature", "faults", "mistake"),
    ),
}


def check_kind(path: Path, content: Mapping[str, object], command: str) -> None:
    """Raise for a file of the other command; `command` is "capture" or "emulate". Files with keys of both, or of none, pass.

    **Raises:** `InputError` with the kind of the file and its command.
    """
    (other,) = _KINDS.keys() - {command}
    (wanted, keys), (found, other_keys) = _KINDS[command], _KINDS[other]
    if (seen := [key for key in other_keys if key in content]) and not any(key in content for key in keys):
        raise InputError(
            f"{path}: {found} for tumblecal {other} (it has {', '.join(seen)}); tumblecal {command} needs {wanted}"
        )


def names_of(names: Sequence[str]) -> tuple[str, ...]:
    """Names of dwells: the name of the position, numbered if it occurs again."""
    counts = Counter[str]()
    numbered = []
    for name in names:
        counts[name] += 1
        numbered.append(name if counts[name] == 1 else f"{name} ({counts[name]})")
    return tuple(numbered)


class Session(Strict):
    """The data of a session: operator, instrument and equipment."""

    title: Line = ""
    operator: Line = ""
    head: Line = ""
    fixture: Line = ""
    mount: Line = "1"
    run: Line = "1"
    notes: str = ""


class PortTable(Strict):
    """Port and protocol of the device."""

    url: str = ""
    baud: int | None = Field(default=None, gt=0)
    protocol: str = "stim300"
    serial_number: Line | None = None
    range_g: Positive | None = None
    rate_hz: Positive | None = None
    speed: Positive = 1.0
    columns: str = ""
    unit: str = ""


class Site(Strict):
    """The site, which gives local gravity unless it was measured."""

    latitude_deg: Number | None = Field(default=None, ge=-90, le=90)
    height_m: Number = 0.0
    gravity_ms2: Number | None = Field(default=None, gt=9.7, lt=9.9)

    @property
    def gravity(self) -> Gravity:
        """Local gravity: as stated, by the normal-gravity formula, or standard gravity if nothing is stated."""
        if self.gravity_ms2 is not None:
            return Gravity(self.gravity_ms2, "given")
        if self.latitude_deg is not None:
            return Gravity(normal_gravity(self.latitude_deg, self.height_m), "normal gravity of latitude and height")
        return Gravity(STANDARD_GRAVITY_MS2, "standard gravity, no site given")

    @property
    def to_local_g(self) -> float:
        """Factor from standard g to local g."""
        return STANDARD_GRAVITY_MS2 / self.gravity.value_ms2


class PlanPosition(Strict):
    """One position of a plan that is not a grid; `temperature_degc`: requested before its dwell."""

    alpha_deg: Number
    beta_deg: Number
    name: Line | None = None
    approach: int | None = None
    temperature_degc: Celsius | None = None


class PositionsTable(Strict):
    """The positions: a grid (for each beta all alpha), or a list; with temperatures, all of them at each temperature."""

    alpha_deg: list[Number] | None = None
    beta_deg: list[Number] | None = None
    listed: list[PlanPosition] | None = None
    temperature_degc: list[Celsius] = Field(default_factory=list)
    mount_rotation_deg: Annotated[list[Number], Field(min_length=3, max_length=3)] | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> "PositionsTable":
        grid = bool(self.alpha_deg) and bool(self.beta_deg)
        if grid == bool(self.listed):
            raise ValueError("give either alpha_deg and beta_deg (a grid), or [[positions.listed]]")
        single = [position.temperature_degc is not None for position in self.listed or []]
        if any(single) and self.temperature_degc:
            raise ValueError("give temperature_degc for all positions together, or for each of them, not both")
        if any(single) and not all(single):
            raise ValueError(f"temperature_degc is missing at listed position {single.index(False) + 1}; add it")
        count = len(self.listed or ()) or len(self.alpha_deg or ()) * len(self.beta_deg or ())
        if (count := count * max(len(self.temperature_degc), 1)) > _MOST_POSITIONS:
            raise ValueError(f"{count} positions; give at most {_MOST_POSITIONS}")
        return self


class DwellTable(Strict):
    """Dwell times, in seconds of the device's time."""

    seconds: Positive = 1200.0
    settle_s: NotNegative = 30.0
    guard_s: NotNegative = 0.0


class PlannedConditions(Strict):
    """The conditions that a proposed plan assumes: times from the last measured position to the first of these, and from one
    to the next, and the temperature."""

    after_s: NotNegative | None = None
    step_s: NotNegative | None = None
    temperature_degc: Number | None = None


class LimitsTable(Strict):
    """Limits for a good dwell."""

    lost_fraction: Number = Field(default=0.01, ge=0, le=1)
    flagged_fraction: Number = Field(default=0.01, ge=0, le=1)
    still_mg: Positive = 2.0
    position_deg: Positive | None = None
    magnitude: Positive = 0.05
    noise_mg: Positive | None = None


class SoakTable(Strict):
    """The criterion of a stable temperature, and whether the pitch settings of each soak are new.

    For `stable_min` minutes, the sensor's temperature is within `tolerance_degc` of the requested one plus `offset_degc`
    (self-heating), and changes by less than `rate_degc_per_min`. `timeout_min`: longest wait. `new_pitch_settings`: each soak
    is a run, so the errors of its pitch settings differ from those of the other soaks.
    """

    tolerance_degc: Positive = 3.0
    rate_degc_per_min: Positive = 0.05
    stable_min: Positive = 10.0
    timeout_min: Positive = 240.0
    offset_degc: Number = 0.0
    new_pitch_settings: bool = False

    @property
    def words(self) -> str:
        """The criterion in words."""
        about = f" plus {self.offset_degc:g}" if self.offset_degc else ""
        return (
            f"for {self.stable_min:g} min, the sensor's temperature is within {self.tolerance_degc:g} degC of the requested one"
            f"{about} and changes by less than {self.rate_degc_per_min:g} degC/min (over {RATE_FRACTION * self.stable_min:g} "
            f"min); longest wait {self.timeout_min:g} min"
        )


def _setting_command(text: str) -> str:
    try:
        if "40" in text.format(40.0):
            return text
    except (ValueError, LookupError, AttributeError):
        pass
    raise ValueError("must have {} where the temperature is inserted, such as 'SOUR:TEMP:SPO {}'")


class ChamberTable(Strict):
    """The line to a temperature chamber with commands in text; without `url`, the operator sets the chamber.

    `set`: command with {} for the temperature, degC. `query`: asks for the temperature of the chamber; its reply is the number
    at `query_field` of a line (1: the first). `set_query`, `set_query_field`: the same for the set point, "" for no check.
    `start`: commands sent first. `finish_degc`: temperature to set when all positions are done.
    """

    url: str = ""
    baud: int = Field(default=9600, gt=0)
    set: Annotated[str, AfterValidator(_setting_command)] = "SOUR:TEMP:SPO {}"
    query: str = Field(default="MEAS:TEMP?", min_length=1)
    query_field: int = Field(default=1, ge=1)
    set_query: str = ""
    set_query_field: int = Field(default=1, ge=1)
    start: list[str] = Field(default_factory=list)
    terminator: Literal["LF", "CR", "CRLF"] = "LF"
    timeout_s: Positive = 2.0
    finish_degc: Celsius | None = None


class _SetupTables(Strict):
    """The tables of a plan that the data of the capture state."""

    session: Session = Session()
    port: PortTable = PortTable()
    dwell: DwellTable = DwellTable()
    limits: LimitsTable = LimitsTable()
    soak: SoakTable = SoakTable()
    chamber: ChamberTable = ChamberTable()


class CapturePlan(_SetupTables):
    """A capture's plan."""

    site: Site = Site()
    positions: PositionsTable
    conditions: PlannedConditions = PlannedConditions()

    @cached_property
    def steps(self) -> list[PlanPosition]:
        """The positions in order, named; temperature is the slowest factor."""
        table = self.positions
        given = table.listed or [
            PlanPosition(alpha_deg=alpha, beta_deg=beta)
            for beta, alpha in product(table.beta_deg or [], table.alpha_deg or [])
        ]
        degrees = table.temperature_degc or [None]
        steps = [(p, p.temperature_degc if degc is None else degc) for degc in degrees for p in given]
        names = [p.name or str(k + 1) for k, (p, _) in enumerate(steps)]
        if table.temperature_degc:
            names = names_of(names)
        return [
            p.model_copy(update={"name": name, "temperature_degc": degc})
            for name, (p, degc) in zip(names, steps, strict=True)
        ]

    @cached_property
    def soaks(self) -> list[int]:
        """The soak of each position, from 0: a new one begins where the temperature changes; 0 without temperatures."""
        grouped = groupby(step.temperature_degc for step in self.steps)
        return [number for number, (_, same) in enumerate(grouped) for _ in same]

    @property
    def over_temperature(self) -> bool:
        """Whether the plan requests temperatures."""
        return self.steps[0].temperature_degc is not None

    @cached_property
    def directions(self) -> NDArray[np.float64]:
        """Nominal specific force at each position in units of local gravity, sensor axes, shape (positions, 3)."""
        forces = [gravity_in_head(np.radians(step.alpha_deg), np.radians(step.beta_deg)) for step in self.steps]
        return np.array(forces) if self.mount is None else np.array(forces) @ self.mount.T

    def expected(self, position: int) -> NDArray[np.float64]:
        """Nominal specific force at a position in units of local gravity, sensor axes, shape (3,)."""
        return self.directions[position]

    @property
    def mount(self) -> NDArray[np.float64] | None:
        """Nominal rotation from the spindle's axes to the sensor's, Rx Ry Rz; None for identity."""
        given = self.positions.mount_rotation_deg
        return None if given is None else rotation_matrix(np.radians(given))

    @cached_property
    def tolerance_deg(self) -> float:
        """Tolerance of a position: half the smallest separation, at most 10 degrees."""
        if self.limits.position_deg is not None:
            return self.limits.position_deg
        half_chords = np.sqrt(np.clip((1.0 - self.directions @ self.directions.T) / 2, 0.0, 1.0))
        separations = np.degrees(2 * np.arcsin(half_chords))
        return float(np.min(separations[separations > 0.1] / 2, initial=10.0))


def read_plan(path: Path) -> CapturePlan:
    """Read and check a plan.

    **Raises:** `InputError` with all faults; for the file of a virtual instrument, with this fault only.
    """
    content = read_toml(path)
    check_kind(path, content, "capture")
    return checked(path, content, CapturePlan)


class CaptureSetup(_SetupTables):
    """The set-up of a capture: session, port, dwell times, limits, soaks, chamber, and the rotation of the triad (deg)."""

    mount_rotation_deg: list[Number] | None = None

    @classmethod
    def of(cls, plan: CapturePlan) -> "CaptureSetup":
        """The set-up of a plan."""
        tables = {name: getattr(plan, name) for name in _SetupTables.model_fields}
        return cls(**tables, mount_rotation_deg=plan.positions.mount_rotation_deg)

    @property
    def text(self) -> str:
        """One line for a comment: the stated keys of the plan, and all of the dwell."""
        content = self.model_dump(exclude_unset=True, exclude=_NOT_COPIED) | {"dwell": self.dwell.model_dump()}
        return json.dumps({name: value for name, value in content.items() if value not in ({}, None)})

    def stated(self, table: str) -> dict[str, Any]:
        """The stated keys of one of its tables, as in a plan; all keys of the dwell."""
        return getattr(self, table).model_dump(exclude_unset=table != "dwell", exclude=_NOT_COPIED.get(table))


def setup_of_comment(text: str | None) -> CaptureSetup | None:
    """The set-up from a comment; None if there is none, or it is not valid."""
    try:
        return CaptureSetup.model_validate_json(text) if text else None
    except ValidationError:
        return None
