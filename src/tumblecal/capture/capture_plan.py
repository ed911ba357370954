"""The plan of a capture: a TOML file with positions, port, dwell time, and the data of the session."""

import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from tumblecal.capture.chamber.chamber_tables import Celsius, ChamberTable, SoakTable
from tumblecal.capture.chamber.soak_order import soak_numbers
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head, rotation_matrix
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2, Gravity, normal_gravity
from tumblecal.ground.strict_toml import Line, Number, Strict, checked, read_toml


SETUP = "capture_setup"
_MOST_POSITIONS = 5000
# The next plan has different ones of these.
_NOT_COPIED = {"session": {"title", "mount", "run", "notes"}, "port": {"serial_number"}}


class FileKind(NamedTuple):
    """A kind of file: its name in words, its command, and the keys that no other kind has."""

    what: str
    command: str
    keys: tuple[str, ...]


PLAN = FileKind(
    "the plan of a capture", "capture", ("session", "port", "positions", "dwell", "limits", "conditions", "soak")
)
INSTRUMENT = FileKind(
    "the description of a virtual instrument",
    "emulate",
    ("instrument", "rig", "effects", "noise", "head", "temperature", "faults", "mistake"),
)


def check_kind(path: Path, content: Mapping[str, object], wanted: FileKind) -> None:
    """Raise for a file of the other kind; `wanted` is `PLAN` or `INSTRUMENT`. Files with keys of both, or of none, pass.

    **Raises:** `InputError` with the kind of the file and its command.
    """
    other = INSTRUMENT if wanted is PLAN else PLAN
    if (found := [key for key in other.keys if key in content]) and not any(key in content for key in wanted.keys):
        raise InputError(
            f"{path}: {other.what} for tumblecal {other.command} (it has {', '.join(found)}); tumblecal {wanted.command} needs "
            f"{wanted.what}"
        )


def names_of(names: Sequence[str]) -> tuple[str, ...]:
    """Names of dwells: the name of the position, numbered if it occurs again."""
    counts: dict[str, int] = {}
    numbered = []
    for name in names:
        counts[name] = counts.get(name, 0) + 1
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
    range_g: Number | None = Field(default=None, gt=0)
    rate_hz: Number | None = Field(default=None, gt=0)
    speed: Number = Field(default=1.0, gt=0)
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

    seconds: Number = Field(default=1200.0, gt=0)
    settle_s: Number = Field(default=30.0, ge=0)
    guard_s: Number = Field(default=0.0, ge=0)


class PlannedConditions(Strict):
    """The conditions that a proposed plan assumes: times from the last measured position to the first of these, and from one
    to the next, and the temperature."""

    after_s: Number | None = Field(default=None, ge=0)
    step_s: Number | None = Field(default=None, ge=0)
    temperature_degc: Number | None = None


class LimitsTable(Strict):
    """Limits for a good dwell."""

    lost_fraction: Number = Field(default=0.01, ge=0, le=1)
    flagged_fraction: Number = Field(default=0.01, ge=0, le=1)
    still_mg: Number = Field(default=2.0, gt=0)
    position_deg: Number | None = Field(default=None, gt=0)
    magnitude: Number = Field(default=0.05, gt=0)
    noise_mg: Number | None = Field(default=None, gt=0)


class CapturePlan(Strict):
    """A capture's plan."""

    session: Session = Session()
    port: PortTable = PortTable()
    site: Site = Site()
    positions: PositionsTable
    dwell: DwellTable = DwellTable()
    limits: LimitsTable = LimitsTable()
    conditions: PlannedConditions = PlannedConditions()
    soak: SoakTable = SoakTable()
    chamber: ChamberTable = ChamberTable()

    @cached_property
    def steps(self) -> list[PlanPosition]:
        """The positions in order, named; temperature is the slowest factor."""
        given = self.positions.listed
        if given is None:
            pairs = product(self.positions.beta_deg or [], self.positions.alpha_deg or [])
            given = [PlanPosition(alpha_deg=alpha, beta_deg=beta) for beta, alpha in pairs]
        if temperatures := self.positions.temperature_degc:
            given = [p.model_copy(update={"temperature_degc": degc}) for degc in temperatures for p in given]
            names = names_of([p.name or str(k + 1) for k, p in enumerate(given)])
            given = [p.model_copy(update={"name": name}) for p, name in zip(given, names, strict=True)]
        return [p.model_copy(update={"name": p.name or str(k + 1)}) for k, p in enumerate(given)]

    @cached_property
    def soaks(self) -> list[int]:
        """The soak of each position, from 0; 0 for all positions of a plan without temperatures."""
        return soak_numbers([step.temperature_degc for step in self.steps])

    @property
    def over_temperature(self) -> bool:
        """Whether the plan requests temperatures."""
        return self.steps[0].temperature_degc is not None

    def expected(self, position: int) -> NDArray[np.float64]:
        """Nominal specific force at a position in units of local gravity, sensor axes, shape (3,)."""
        step = self.steps[position]
        force = gravity_in_head(np.radians(step.alpha_deg), np.radians(step.beta_deg))
        mount = self.mount
        return force if mount is None else mount @ force

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
        forces = np.array([self.expected(k) for k in range(len(self.steps))])
        separations = np.degrees(2 * np.arcsin(np.sqrt(np.clip((1.0 - forces @ forces.T) / 2, 0.0, 1.0))))
        return float(np.min(separations[separations > 0.1] / 2, initial=10.0))


def read_plan(path: Path) -> CapturePlan:
    """Read and check a plan.

    **Raises:** `InputError` with all faults; for the file of a virtual instrument, with this fault only.
    """
    content = read_toml(path)
    check_kind(path, content, PLAN)
    return checked(path, content, CapturePlan)


class CaptureSetup(Strict):
    """The set-up of a capture: session, port, dwell times, limits, soaks, chamber, and the rotation of the triad (deg)."""

    session: Session = Session()
    port: PortTable = PortTable()
    dwell: DwellTable = DwellTable()
    limits: LimitsTable = LimitsTable()
    soak: SoakTable = SoakTable()
    chamber: ChamberTable = ChamberTable()
    mount_rotation_deg: list[Number] | None = None

    @classmethod
    def of(cls, plan: CapturePlan) -> "CaptureSetup":
        """The set-up of a plan."""
        return cls(
            session=plan.session,
            port=plan.port,
            dwell=plan.dwell,
            limits=plan.limits,
            soak=plan.soak,
            chamber=plan.chamber,
            mount_rotation_deg=plan.positions.mount_rotation_deg,
        )

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
    if not text:
        return None
    try:
        return CaptureSetup.model_validate_json(text)
    except ValidationError:
        return None
