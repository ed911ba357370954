"""Rigs from TOML, checked strictly: all faults are reported together, with their dotted paths."""

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from tumblecal.chain.considered import Considered
from tumblecal.chain.head_ability import HeadAbilityTable
from tumblecal.chain.nominal import LINKS, NOMINAL, UNIT_OF_LEAF, Leaf, unit_in
from tumblecal.chain.plan_table import PlanTable
from tumblecal.chain.rig import EffectLinks, Rig
from tumblecal.chain.rig_temperature import TemperatureTable, rig_temperature
from tumblecal.ground.errors import InputError
from tumblecal.ground.examples import file_or_example
from tumblecal.ground.option_texts import faults_of, sizes
from tumblecal.ground.strict_toml import Line, Number, Numbers, SdOrNone, Strict, checked, read_toml
from tumblecal.ground.toml_faults import located
from tumblecal.ground.units import factor


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

    sd: SdOrNone


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
    temperature: TemperatureTable = TemperatureTable()
    head: HeadAbilityTable | None = None


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
        try:
            with faults_of(f"{path}: truth.{name}"):
                unit = unit_in(units)(name)
            with faults_of(f"{path}: truth.{name}.unit"):
                truth[name] = tuple(number * factor(given.unit, unit) for number in numbers)
        except InputError as error:
            faults += error.faults

    def read(key: str, given: Mapping[str, str], units: Mapping[str, str]) -> dict[str, float]:
        try:
            return sizes(f"{path}: {key}.", given, unit_in(units))
        except InputError as error:
            faults.extend(error.faults)
            return {}

    priors = read("priors", table.priors, units)
    # The residual sd is not a parameter.
    usual = read("usual", table.usual, units | {"scatter": "g"})
    temperature = rig_temperature(table.temperature, table.chain.links, faults, str(path))
    if faults:
        raise InputError(located(path, faults))
    plan = table.plan.plan()
    of_plan = tuple(sorted(set(plan.beta_deg))), tuple(dict.fromkeys(plan.mounts))
    return Rig(
        title=table.title,
        plan=plan,
        links=tuple(table.chain.links),
        leaves={name: Leaf(leaf.by, leaf.free) for name, leaf in table.chain.leaves.items()},
        mounts={name: (m.rotation_deg[0], m.rotation_deg[1], m.rotation_deg[2]) for name, m in table.mounts.items()},
        effects=tuple(table.chain.effects),
        effect_links=effects,
        truth=truth,
        noise_sd_g=None if table.noise is None else table.noise.sd,
        priors={name: (0.0, size) for name, size in priors.items()},
        usual=usual,
        considered=table.considered,
        temperature=temperature,
        ability=None if table.head is None else table.head.ability(*of_plan),
        source=str(path),
    )


def _near(name: str, known: Mapping[str, object]) -> str:
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.4)
    return f"did you mean {' or '.join(near)}?" if near else "`tumblecal effects` lists them"
