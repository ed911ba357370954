"""The measured errors of a dividing head, and `head.toml`, which holds them with their covariance."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from tumblecal.chain.chain import Chain
from tumblecal.chain.link import Link
from tumblecal.chain.nominal import UNIT_OF_LEAF
from tumblecal.chain.parameter import Parameter
from tumblecal.chain.rig_file import unit_of_parameter
from tumblecal.chain.where import Where
from tumblecal.ground.errors import InputError
from tumblecal.ground.strict_toml import Line, Number, Strict, checked, read_toml, toml_string
from tumblecal.ground.toml_faults import located
from tumblecal.ground.units import factor, shown


# Several parameters of a chain that share one of the head (dbeta of a setting, by run) may differ by this share of its sd.
_SAME = 0.1
# A pitch setting is told from another by this many decimals of a degree.
_DECIMALS = 6


def pitch_name(beta_rad: float) -> str:
    """The name of the error of a pitch setting, whatever its number in a plan: `dbeta@45`."""
    return f"dbeta@{round(float(np.degrees(beta_rad)), _DECIMALS) + 0.0:g}"


def pitch_names(leaf: Parameter, where: Where) -> tuple[str, ...]:
    """That name for every dbeta of a chain."""
    groups = np.asarray(where.index(leaf.by)) if leaf.by else np.zeros(len(np.asarray(where.beta)), int)
    return tuple(pitch_name(where.pitch_angle[groups == group][0]) for group in range(len(leaf.names)))


@dataclass(frozen=True)
class MeasuredHead:
    """What is known of a head.

    - `effects`: ids of its errors; `names`: of their coefficients, then of the pitch settings' errors (`dbeta@45`).
    - `values`, `covariance`: in base units (rad, g and their products).
    - `made_of`: the files it was measured with.
    """

    effects: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Float[np.ndarray, " errors"]
    covariance: Float[np.ndarray, "errors errors"]
    made_of: tuple[str, ...] = ()

    @property
    def sd(self) -> Float[np.ndarray, " errors"]:
        """Standard deviations of the values."""
        return np.sqrt(np.diag(self.covariance))

    def extended(self, chain: Chain, where: Where, link_of: Callable[[str, Where], Link], *, known: bool) -> Chain:
        """A chain with the head's errors in it.

        **Arguments:**

        - `link_of`: makes an effect's link, by its id.
        - `known`: whether the noise of the data is; else the errors' uncertainty cannot be weighed against the data: they
          are kept at their values.
        """
        values, there = (
            dict(zip(self.names, self.values.tolist(), strict=True)),
            {leaf.name for leaf in chain.parameters},
        )
        for id in self.effects:
            try:
                link = link_of(id, where)
            except InputError:
                continue  # a column that it needs is not there: nothing can be said of it in these data
            leaves = Chain((link,)).free
            if any(leaf.name in there for leaf in leaves):
                continue
            if not known:
                own = {name: values[name] for leaf in leaves for name in leaf.names if name in values}
                link = Chain((link,)).named(own).fixed({leaf.name for leaf in leaves}).links[0]
            chain = chain + link
        return chain

    def priors(self, chain: Chain, where: Where) -> dict[tuple[str, ...], tuple[np.ndarray, np.ndarray]]:
        """What the head says of a chain's free parameters: means and covariance by their names; nothing where it has
        none of them."""
        pairs = [
            (name, self.names.index(own))
            for leaf in chain.free
            for name, own in zip(
                leaf.names, pitch_names(leaf, where) if leaf.name == "dbeta" else leaf.names, strict=True
            )
            if own in self.names
        ]
        if not pairs:
            return {}
        names, numbers = zip(*pairs, strict=True)
        chosen = np.array(numbers)
        covariance = self.covariance[np.ix_(chosen, chosen)]
        twice = np.array([numbers.count(number) > 1 for number in numbers])
        covariance = covariance + np.diag(np.where(twice, _SAME**2 * np.diag(covariance), 0.0))
        return {names: (self.values[chosen], covariance)}

    def text(self) -> str:
        """The file's content."""
        scales = np.array([shown(unit)[1] for unit in self.units])
        covariance = self.covariance * np.outer(scales, scales)
        lines = [
            "# Errors of a dividing head, measured by tumblecal diagnose --units. Give it as --head to calibrate and diagnose.",
            "# Directions that no data showed are kept at zero by a very small variance.",
            'schema = "tumblecal.head/1"',
            f"made_of = [{', '.join(map(toml_string, self.made_of))}]",
            f"effects = [{', '.join(map(toml_string, self.effects))}]",
            f"parameters = [{', '.join(map(toml_string, self.names))}]",
            f"units = [{', '.join(toml_string(shown(unit)[0]) for unit in self.units)}]",
            f"values = {_numbers(self.values * scales)}",
            f"sd = {_numbers(self.sd * scales)}",
            "covariance = [",
            *(f"    {_numbers(row)}," for row in covariance),
            "]",
        ]
        return "\n".join(lines) + "\n"


def _numbers(row: Sequence[float] | np.ndarray) -> str:
    return "[" + ", ".join(f"{float(value):.12e}" for value in row) + "]"


class HeadTable(Strict):
    """A head file; `sd` repeats the covariance's diagonal for people."""

    schema_: Annotated[Literal["tumblecal.head/1"], Field(alias="schema")]
    made_of: list[Line]
    effects: list[str]
    parameters: Annotated[list[str], Field(min_length=1)]
    units: list[str]
    values: list[Number]
    sd: list[Number]
    covariance: list[list[Number]]


def read_head(path: Path, links: Collection[str], effect_units: Mapping[str, str]) -> MeasuredHead:
    """Read a head file.

    **Arguments:**

    - `links`: ids of the effects that a chain can have; `effect_units`: base units of their coefficients.

    **Raises:** `InputError` with every fault and where it stands.
    """
    table = checked(path, read_toml(path), HeadTable)
    count, units = len(table.parameters), UNIT_OF_LEAF | dict(effect_units)
    faults = [
        f"{path}: {name}: {len(given)} entries for {count} parameters"
        for name, given in (("units", table.units), ("values", table.values), ("covariance", table.covariance))
        if len(given) != count
    ]
    faults += [
        f"{path}: covariance.{number}: {len(row)} entries for {count} parameters"
        for number, row in enumerate(table.covariance)
        if len(row) != count
    ]
    faults += [
        f"{path}: effects: unknown effect {id!r}; `tumblecal effects` lists them"
        for id in table.effects
        if id not in links
    ]
    if len(set(table.parameters)) != count:
        faults.append(f"{path}: parameters: a name stands there twice")
    bases = [unit_of_parameter(name, units) for name in table.parameters]
    faults += [
        f"{path}: parameters: no parameter {name!r} of a head"
        for name, base in zip(table.parameters, bases, strict=True)
        if base is None
    ]
    if faults:
        raise InputError(located(path, faults))
    scales = np.ones(count)
    for number, (unit, base) in enumerate(zip(table.units, bases, strict=True)):
        try:
            scales[number] = factor(unit, base or "1")
        except InputError as error:
            faults.append(f"{path}: units.{number}: {error}")
    covariance = np.array(table.covariance) * np.outer(scales, scales)
    if not np.allclose(covariance, covariance.T, rtol=1e-6, atol=0.0) or not _positive(covariance):
        faults.append(f"{path}: covariance: not symmetric and positive definite")
    if faults:
        raise InputError(located(path, faults))
    return MeasuredHead(
        tuple(table.effects),
        tuple(table.parameters),
        tuple(base or "1" for base in bases),
        np.array(table.values) * scales,
        (covariance + covariance.T) / 2,
        tuple(table.made_of),
    )


def _positive(matrix: np.ndarray) -> bool:
    sd = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return bool(np.all(np.diag(matrix) > 0) and np.min(np.linalg.eigvalsh(matrix / np.outer(sd, sd))) > 0)
