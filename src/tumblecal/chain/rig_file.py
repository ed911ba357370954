"""Rigs from TOML, checked strictly: all faults are reported together, with their dotted paths."""

import difflib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from tumblecal.chain.considered import Considered
from tumblecal.chain.nominal import LINKS, NOMINAL, UNIT_OF_LEAF, Leaf
from tumblecal.chain.plan import Plan, grid
from tumblecal.chain.rig import EffectLinks, Rig
from tumblecal.ground.errors import InputError
from tumblecal.ground.examples import file_or_example
from tumblecal.ground.strict_toml import Line, Number, Numbers, Strict, checked, read_toml
from tumblecal.ground.toml_faults import located
from tumblecal.ground.units import factor, quantity, reading_sd


# Conditions that a plan may state for each position.
_CONDITIONS = ("time_s", "temperature_degc", "approach")
# A plan larger than this is a typing error.
MOST_POSITIONS = 100_000


class Steps(Strict):
    """Equally spaced values."""

    start: Number
    step: Number
    count: Annotated[int, Field(ge=1, le=MOST_POSITIONS)]

    @model_validator(mode="after")
    def _has_a_step(self) -> "Steps":
        if self.step == 0 and self.count > 1:
            raise ValueError(
                f"step is 0, so all {self.count} positions would be equal; write the step (runs repeats a plan)"
            )
        return self

    @property
    def values(self) -> list[float]:
        """The values."""
        return [self.start + self.step * place for place in range(self.count)]


Angles = Annotated[
    Annotated[list[Number], Tag("list")] | Annotated[Steps, Tag("steps")],
    Discriminator(
        lambda given: "list" if isinstance(given, list) else "steps" if isinstance(given, dict | Steps) else None,
        custom_error_type="angles",
        custom_error_message="must be a list of numbers such as [0, 45, 90], or { start = 0, step = 45, count = 3 }",
    ),
]


class Position(Strict):
    """One position of a plan that is not a grid; time, temperature and approach are stated for all positions or for none."""

    alpha_deg: Number
    beta_deg: Number
    name: Line | None = None
    mount: Line = "1"
    run: Line = "1"
    time_s: Number | None = None
    temperature_degc: Number | None = None
    approach: Literal[-1, 1] | None = None


class Ramp(Strict):
    """A quantity that changes linearly over the plan."""

    start: Number
    end: Number


class PlanTable(Strict):
    """The `[plan]` table: a grid (alpha_deg x beta_deg) or a list of positions.

    `interval_s` is the time from one position to the next, `temperature_degc` the triad's from first to last,
    `approach` the direction in which the spindle approaches its positions; listed positions may state these individually.
    """

    alpha_deg: Angles | None = None
    beta_deg: Angles | None = None
    mounts: Annotated[list[Line], Field(min_length=1)] = ["1"]
    runs: Annotated[int, Field(ge=1, le=MOST_POSITIONS)] = 1
    positions: list[Position] | None = None
    interval_s: Annotated[Number, Field(gt=0)] | None = None
    temperature_degc: Ramp | None = None
    approach: Literal["positive", "negative", "alternating"] | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> "PlanTable":
        is_grid = self.alpha_deg is not None and self.beta_deg is not None
        if is_grid == (self.positions is not None):
            raise ValueError("give either alpha_deg and beta_deg (a grid), or positions")
        for column in _CONDITIONS:
            stated = [getattr(position, column) is not None for position in self.positions or []]
            if any(stated) and not all(stated):
                raise ValueError(
                    f"positions: {column} is stated for {sum(stated)} of {len(stated)}; state all, or none"
                )
            if any(stated) and (self.interval_s if column == "time_s" else getattr(self, column)) is not None:
                raise ValueError(f"{column} is stated for the plan and for its positions; state one of them")
        count = self._count
        if not 0 < count <= MOST_POSITIONS:
            raise ValueError(f"{count} positions; give 1 to {MOST_POSITIONS}")
        return self

    @property
    def _count(self) -> int:
        if self.positions is not None:
            return len(self.positions)
        return len(_values(self.alpha_deg)) * len(_values(self.beta_deg)) * len(self.mounts) * self.runs

    def plan(self) -> Plan:
        """The plan described."""
        plan, count = self._bare(), len(self._bare())
        signs = {None: None, "positive": [1.0], "negative": [-1.0], "alternating": [1.0, -1.0]}[self.approach]
        step = self.interval_s
        ramp = self.temperature_degc
        if self.positions is not None:
            stated = {name: tuple(getattr(position, name) for position in self.positions) for name in _CONDITIONS}
            plan = replace(plan, **{name: values for name, values in stated.items() if None not in values})
        return replace(
            plan,
            time_s=plan.time_s if step is None else tuple(step * number for number in range(count)),
            temperature_degc=plan.temperature_degc
            if ramp is None
            else tuple(ramp.start + (ramp.end - ramp.start) * number / max(count - 1, 1) for number in range(count)),
            approach=plan.approach if signs is None else tuple(signs[number % len(signs)] for number in range(count)),
        )

    def _bare(self) -> Plan:
        if self.positions is not None:
            names = tuple(p.name or str(number) for number, p in enumerate(self.positions, start=1))
            return Plan(
                names,
                tuple(p.alpha_deg for p in self.positions),
                tuple(p.beta_deg for p in self.positions),
                tuple(p.mount for p in self.positions),
                tuple(p.run for p in self.positions),
            )
        return grid(_values(self.alpha_deg), _values(self.beta_deg), mounts=self.mounts, runs=self.runs)


def _values(angles: "list[float] | Steps | None") -> list[float]:
    return angles.values if isinstance(angles, Steps) else angles or []


if TYPE_CHECKING:
    LinkName = str
    LeafName = str
else:
    LinkName, LeafName = Literal[tuple(LINKS)], Literal[tuple(UNIT_OF_LEAF)]


class LeafTable(Strict):
    """How a leaf is indexed and whether it is estimated."""

    by: str | None = None
    free: bool = True


class ChainTable(Strict):
    """The `[chain]` table: links from the ground to the reading, and their leaves."""

    links: list[LinkName] = list(NOMINAL)
    effects: list[str] = []
    leaves: dict[LeafName, LeafTable] = {}


class MountTable(Strict):
    """Intended rotation of a mounting, `Rx Ry Rz` as for dtheta."""

    rotation_deg: Annotated[list[Number], Field(min_length=3, max_length=3)]


class Values(Strict):
    """Numbers with their unit."""

    value: Numbers
    unit: str


class NoiseTable(Strict):
    """White noise of a position mean."""

    sd: str


class RigTable(Strict):
    """A whole rig file."""

    schema_: Annotated[Literal["tumblecal.rig/1"], Field(alias="schema")]
    title: Line = ""
    plan: PlanTable
    chain: ChainTable = ChainTable()
    mounts: dict[str, MountTable] = {}
    truth: dict[str, Values] = {}
    noise: NoiseTable | None = None
    priors: dict[str, str] = {}
    usual: dict[str, str] = {}
    considered: dict[str, Considered] = {}


def read_rig(
    path: Path | str, effects: EffectLinks | None = None, effect_units: Mapping[str, str] | None = None
) -> Rig:
    """Read a rig.

    **Arguments:**

    - `path`: the TOML file, or the name of an example.
    - `effects`: links that `chain.effects` may name, by id.
    - `effect_units`: base unit of each effect's leaves or coefficients, by name.

    **Raises:** `InputError` with every fault and its dotted path.
    """
    file = file_or_example(path)
    # An example is named without the folder of the installation.
    named = Path(path) if file == Path(path) else Path(file.name)
    return rig_of(read_toml(file), named, effects, effect_units)


def rig_of(
    content: Mapping[str, object],
    path: Path,
    effects: EffectLinks | None = None,
    effect_units: Mapping[str, str] | None = None,
) -> Rig:
    """The rig that the content of a rig file describes; `path` is named in faults.

    **Raises:** `InputError` with every fault and its dotted path.
    """
    table = checked(path, content, RigTable)
    effects, faults = dict(effects or {}), []
    units = UNIT_OF_LEAF | dict(effect_units or {})
    faults += [
        f"{path}: chain.effects: unknown effect {name!r}; {_near(name, effects)}"
        for name in table.chain.effects
        if name not in effects
    ]
    truth: dict[str, tuple[float, ...]] = {}
    for name, given in table.truth.items():
        numbers = given.value if isinstance(given.value, list) else [given.value]
        unit = unit_of_parameter(name, units)
        if unit is None:
            faults.append(f"{path}: truth.{name}: no such parameter; {_near(name, units)}")
            continue
        try:
            truth[name] = tuple(number * factor(given.unit, unit) for number in numbers)
        except InputError as error:
            faults.append(f"{path}: truth.{name}.unit: {error}")
    priors = _sizes(path, "priors", table.priors, units, faults)
    # The residual sd is not a parameter.
    usual = _sizes(path, "usual", table.usual, units | {"scatter": "g"}, faults)
    noise = None
    if table.noise is not None:
        try:
            noise = reading_sd(table.noise.sd, none=True)
        except InputError as error:
            faults.append(f"{path}: noise.sd: {error}")
    if faults:
        raise InputError(located(path, faults))
    return Rig(
        title=table.title,
        plan=table.plan.plan(),
        links=tuple(table.chain.links),
        leaves={name: Leaf(leaf.by, leaf.free) for name, leaf in table.chain.leaves.items()},
        mounts={name: (m.rotation_deg[0], m.rotation_deg[1], m.rotation_deg[2]) for name, m in table.mounts.items()},
        effects=tuple(table.chain.effects),
        effect_links=effects,
        truth=truth,
        noise_sd_g=noise,
        priors={name: (0.0, size) for name, size in priors.items()},
        usual=usual,
        considered=table.considered,
        source=str(path),
    )


def _sizes(
    path: Path, key: str, given: Mapping[str, str], units: Mapping[str, str], faults: list[str]
) -> dict[str, float]:
    """Sizes of parameters in base units from a table of texts; faults are added to the list."""
    sizes: dict[str, float] = {}
    for name, text in given.items():
        unit = unit_of_parameter(name, units)
        try:
            sizes[name] = quantity(text, unit or "1")
            if not sizes[name] > 0:
                faults.append(f"{path}: {key}.{name}: {text!r} is not a size; give a value above 0")
        except InputError as error:
            faults.append(f"{path}: {key}.{name}: {error}")
        if unit is None:
            faults.append(f"{path}: {key}.{name}: no such parameter; {_near(name, units)}")
    return sizes


def _near(name: str, known: Mapping[str, object]) -> str:
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.4)
    return f"did you mean {' or '.join(near)}?" if near else "`tumblecal effects` lists them"


def unit_of_parameter(name: str, units: Mapping[str, str]) -> str | None:
    """The unit of a leaf (`dbeta`) or of one of its parameters (`dbeta_0`, `dK_x@run=2`)."""
    bare = name.partition("@")[0]
    while bare not in units and "_" in bare:
        bare = bare.rpartition("_")[0]
    return units.get(bare)
