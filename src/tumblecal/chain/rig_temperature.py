"""The `[temperature]` table of a rig file: leaves that follow temperature, and their true coefficients."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field, create_model, model_validator

from tumblecal.chain.chain import Chain
from tumblecal.chain.following import followings_of, require_temperature
from tumblecal.chain.nominal import LINKS, UNIT_OF_LEAF, Leaf
from tumblecal.chain.where import Where
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted
from tumblecal.ground.option_texts import faults_of
from tumblecal.ground.soaks import soaks
from tumblecal.ground.strict_toml import Number, Strict
from tumblecal.ground.temperature_functions import (
    HIGHEST_ORDER,
    SPLINE_ORDER,
    TemperatureFunctions,
    form_words,
    unit_divisors,
)
from tumblecal.ground.units import quantity


# The reference temperature if none is stated and the range includes it.
_USUAL_REFERENCE = 25.0
# Values of each position include any change with temperature.
_NEVER = ("tilt",)
_MOST_LISTED = 8


@dataclass(frozen=True)
class LeafTemperature:
    """How one leaf follows temperature: by a polynomial of this order, or with knots by a cubic spline.

    `truth`: true physical coefficients by component (base units per degC^k), for simulation; zero where absent.
    """

    order: int
    knots_degc: tuple[float, ...] = ()
    truth: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """The number of functions."""
        return self.order + len(self.knots_degc)

    @property
    def words(self) -> str:
        """`order 3`, or a cubic spline with its knots."""
        return form_words(self.order, self.knots_degc)


@dataclass(frozen=True)
class RigTemperature:
    """The leaves that follow temperature, by name.

    `reference_degc`: T0, at which the parameters without `_T` in their names are given; None: 25 degC if the range includes it,
    otherwise its middle. `range_degc`: None: that of the data.
    """

    leaves: Mapping[str, LeafTemperature] = field(default_factory=dict)
    reference_degc: float | None = None
    range_degc: tuple[float, float] | None = None

    @property
    def words(self) -> str:
        """The leaves, each with its order or knots."""
        return ", ".join(f"{name} by {how.words}" for name, how in self.leaves.items())

    def into(self, leaves: Mapping[str, Leaf], where: Where, *, fitted: bool = True) -> dict[str, Leaf]:
        """The leaves of the rig for some positions, those in this table with their functions of temperature.

        `fitted`: whether these positions must determine the functions.

        **Raises:** `InputError`, beginning with the name of the leaf, for data without temperatures, or with too few.
        """
        usual = {name: leaf.usual for link in LINKS.values() for name, leaf in link.leaves.items()}
        made = dict(leaves)
        for name, how in self.leaves.items():
            if not how.count:
                continue
            with faults_of(name):
                if fitted:
                    require_temperature(name, where)
                    _require_soaks(name, how, soaks(np.asarray(where.temperature_degc)))
                reference, limits = self.reference_and_range(name, where)
                functions = TemperatureFunctions(how.order, reference, limits, how.knots_degc)
            made[name] = replace(leaves.get(name, usual[name]), follows=functions)
        return made

    def reference_and_range(self, name: str, where: Where) -> tuple[float, tuple[float, float]]:
        """T0 and the range as stated, otherwise those of these positions.

        **Raises:** `InputError` if the range is not stated and the positions have no temperatures, for the leaf `name`.
        """
        limits = self.range_degc
        if limits is None:
            require_temperature(name, where)
            degc = np.asarray(where.temperature_degc)
            limits = float(degc.min()), float(degc.max())
        usual = _USUAL_REFERENCE if limits[0] <= _USUAL_REFERENCE <= limits[1] else sum(limits) / 2
        return usual if self.reference_degc is None else self.reference_degc, limits

    def stated_for(self, where: Where) -> "RigTemperature":
        """The same with T0 and range stated as these positions have them."""
        if not any(how.count for how in self.leaves.values()):
            return self
        reference, limits = self.reference_and_range(next(iter(self.leaves)), where)
        return replace(self, reference_degc=reference, range_degc=limits)

    def truth(self, chain: Chain) -> dict[str, float]:
        """The true values of the changes of a chain that was made with these leaves."""
        values: dict[str, float] = {}
        for leaf in followings_of(chain):
            name = leaf.reference.name
            physical = np.zeros((leaf.functions.count, len(leaf.reference.components)))
            for column, component in enumerate(leaf.reference.components):
                stated = self.leaves[name].truth.get(component or name, ())
                physical[: len(stated), column] = stated
            values |= dict(
                zip(leaf.change.names, leaf.functions.of_coefficients(physical).ravel().tolist(), strict=True)
            )
        return values


def _require_soaks(name: str, how: LeafTemperature, found: list[float]) -> None:
    """Reject more functions than the temperatures of the data determine: k soaks determine k - 1 functions.

    **Raises:** `InputError`.
    """
    count = len(found)
    if how.count < count:
        return
    if count == 1:
        raise InputError(
            f"all positions have one temperature ({found[0]:.4g} degC), which determines no change of {name}; measure at "
            f"{how.count + 1} or more temperatures, or remove [temperature.{name}]"
        )
    possible = f"order {min(count - 1, HIGHEST_ORDER)}"
    if how.knots_degc and count > SPLINE_ORDER + 1:
        possible = counted(count - SPLINE_ORDER - 1, "knot")
    listed = ", ".join(f"{degc:.4g}" for degc in found[:_MOST_LISTED]) + (", ..." if count > _MOST_LISTED else "")
    raise InputError(
        f"{how.words} needs {how.count + 1} or more soaks; the data have {count} soaks ({listed} degC), which determine at "
        f"most {possible}"
    )


class FollowingTable(Strict):
    """A `[temperature.LEAF]` table: the order of a polynomial, or the knots of a cubic spline; true coefficients."""

    order: Annotated[int, Field(ge=0, le=HIGHEST_ORDER)] | None = None
    knots_degc: list[Number] = []
    truth: dict[str, list[str]] = {}

    @model_validator(mode="after")
    def _one_form(self) -> "FollowingTable":
        if self.order is None and not self.knots_degc:
            raise ValueError("give order = 0 to 5 (a polynomial), or knots_degc = [10, 30] (a cubic spline)")
        if self.knots_degc and self.order not in (None, SPLINE_ORDER):
            raise ValueError(f"a cubic spline has order {SPLINE_ORDER}; remove order, or knots_degc")
        return self


class _ForAllLeaves(Strict):
    """The keys of `[temperature]` that apply to all leaves."""

    reference_degc: Number | None = None
    range_degc: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = None

    @model_validator(mode="after")
    def _increasing(self) -> "_ForAllLeaves":
        if self.range_degc and not self.range_degc[0] < self.range_degc[1]:
            raise ValueError("range_degc: the first temperature must be below the second")
        return self


# The table has a key for each leaf.
_KEYS: Any = {leaf: (FollowingTable | None, None) for leaf in UNIT_OF_LEAF if leaf not in _NEVER}
if TYPE_CHECKING:
    TemperatureTable = _ForAllLeaves
else:
    TemperatureTable = create_model("TemperatureTable", __base__=_ForAllLeaves, **_KEYS)


def rig_temperature(table: TemperatureTable, links: list[str], faults: list[str], named: str) -> RigTemperature:
    """The leaves that follow temperature by a checked table; faults, which begin with `named`, are added to the list."""
    stated = {leaf: own for leaf in _KEYS if (own := getattr(table, leaf)) is not None}
    present = {leaf for link in links for leaf in LINKS[link].leaves}
    for leaf in [leaf for leaf in stated if leaf not in present]:
        faults.append(f"{named}: temperature.{leaf}: chain.links has no link with this leaf")
    leaves = {}
    for leaf, own in stated.items():
        how = LeafTemperature(SPLINE_ORDER if own.knots_degc else own.order, tuple(own.knots_degc))
        truth = dict(_coefficients(leaf, how, own.truth, faults, f"{named}: temperature.{leaf}.truth"))
        leaves[leaf] = replace(how, truth=truth)
        if list(own.knots_degc) != sorted(set(own.knots_degc)):
            faults.append(f"{named}: temperature.{leaf}.knots_degc: the knots must increase")
    limits = table.range_degc
    return RigTemperature(leaves, table.reference_degc, (limits[0], limits[1]) if limits else None)


def _coefficients(
    leaf: str, how: LeafTemperature, truth: Mapping[str, list[str]], faults: list[str], at: str
) -> Iterator[tuple[str, tuple[float, ...]]]:
    """The true coefficients of each component, base units; faults are added to the list."""
    unit, components = next(
        (named.leaves[leaf].unit, named.leaves[leaf].components) for named in LINKS.values() if leaf in named.leaves
    )
    keys = tuple(component or leaf for component in components)
    for component, texts in truth.items():
        if component not in keys:
            faults.append(f"{at}.{component}: no such component; {leaf} has {', '.join(keys)}")
        elif len(texts) != how.count:
            faults.append(
                f"{at}.{component}: {len(texts)} coefficients, but {leaf} has {how.count} functions of temperature"
            )
        else:
            values = []
            per_degc = unit_divisors(how.order, len(how.knots_degc))
            for number, (text, divisor) in enumerate(zip(texts, per_degc, strict=True)):
                try:
                    values.append(quantity(text, unit + divisor))
                except InputError as error:
                    faults.append(f"{at}.{component}.{number}: {error}")
            yield component, tuple(values)


def temperature_content(chain: Chain) -> dict[str, Any]:
    """The table `temperature` of a rig file for the leaves of a chain that follow temperature, with their physical
    coefficients; empty without any."""
    content = dict[str, Any]()
    for leaf in followings_of(chain):
        functions, name, components = leaf.functions, leaf.reference.name, leaf.reference.components
        physical = np.reshape(leaf.change.value, (functions.count, len(components))).T @ functions.combination
        units = [leaf.reference.unit + divisor for divisor in functions.units]
        truth = {
            (component or name): [f"{number!r} {unit}" for number, unit in zip(row, units, strict=True)]
            for component, row in zip(components, physical.tolist(), strict=True)
        }
        form = {"knots_degc": functions.knots_degc} if functions.knots_degc else {"order": functions.order}
        content |= {"reference_degc": functions.reference_degc, "range_degc": functions.range_degc}
        content[name] = form | {"truth": truth}
    return content
