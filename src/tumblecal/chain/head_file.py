"""The measured errors of a dividing head, and `head.toml`, which contains them with their covariance."""

import hashlib
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from tumblecal.chain.chain import Chain
from tumblecal.chain.link import Link
from tumblecal.chain.nominal import PITCH_ERROR, UNIT_OF_LEAF, unit_of_parameter
from tumblecal.chain.parameter import Parameter
from tumblecal.chain.where import Where
from tumblecal.ground.errors import InputError
from tumblecal.ground.record import ResultRecord, TextOrNull, at
from tumblecal.ground.strict_toml import Line, Number, Strict, checked, read_toml, toml_string
from tumblecal.ground.toml_faults import located
from tumblecal.ground.units import factor, shown


# Parameters of a chain that share one of the head (dbeta of a setting, by run) may differ by this share of its sd.
_SAME = 0.1
# Tolerance for rounded sd values, relative to the covariance.
_ROUNDED = 0.05
# Pitch settings are distinguished by this many decimals of a degree.
_DECIMALS = 6


def pitch_name(beta_rad: float) -> str:
    """The name of the error of a pitch setting (rad), independent of its number in a plan: `dbeta@45`."""
    return f"{PITCH_ERROR}{round(float(np.degrees(beta_rad)), _DECIMALS) + 0.0:g}"


def _is_pitch_name(name: str) -> bool:
    """Whether this is the exact name of a pitch setting's error; another spelling of the angle would not match any plan."""
    _, _, degrees = name.partition("@")
    try:
        angle = float(degrees)
    except ValueError:
        return False
    return math.isfinite(angle) and name == pitch_name(math.radians(angle))


def pitch_names(leaf: Parameter, where: Where) -> tuple[str, ...]:
    """That name for every dbeta of a chain."""
    groups = np.asarray(where.index(leaf.by)) if leaf.by else np.zeros(len(np.asarray(where.beta)), int)
    return tuple(pitch_name(where.pitch_angle[groups == group][0]) for group in range(len(leaf.names)))


class HeadRecord(ResultRecord):
    """A `MeasuredHead` in the provenance of a calibration: the errors that its chain uses."""

    file: TextOrNull = at("source")
    sha256: TextOrNull
    made_of: list[str]
    parameters: list[str]
    exact: bool


@dataclass(frozen=True)
class MeasuredHead:
    """The measured errors of a head.

    - `effects`: ids of its errors; `names`: of their coefficients, then of the pitch settings' errors (`dbeta@45`).
    - `values`, `covariance`: in base units (rad, g and their products).
    - `made_of`: the data files of the measurement. `source`, `sha256`: the head file; "" if there is none.
    """

    effects: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Float[np.ndarray, " errors"]
    covariance: Float[np.ndarray, "errors errors"]
    made_of: tuple[str, ...] = ()
    source: str = ""
    sha256: str = ""

    @property
    def sd(self) -> Float[np.ndarray, " errors"]:
        """Standard deviations of the values."""
        return np.sqrt(np.diag(self.covariance))

    def extended(self, chain: Chain, where: Where, link_of: Callable[[str, Where], Link], *, known: bool) -> Chain:
        """A chain with the head's errors in it.

        **Arguments:**

        - `link_of`: makes an effect's link, by its id.
        - `known`: whether the noise of the data is known; otherwise the uncertainty of the errors cannot be weighted
          against the data, and they are fixed at their values.
        """
        values = dict(zip(self.names, self.values.tolist(), strict=True))
        present = {leaf.name for leaf in chain.parameters}
        for id in self.effects:
            try:
                link = link_of(id, where)
            except InputError:
                continue  # a column that it needs is missing, so it cannot act in these data
            leaves = Chain((link,)).free
            self._reject_unknown(leaves)
            if any(leaf.name in present for leaf in leaves):
                continue
            if not known:
                stated = {name: values[name] for leaf in leaves for name in leaf.names if name in values}
                link = Chain((link,)).named(stated).fixed({leaf.name for leaf in leaves}).links[0]
            chain = chain + link
        return chain

    def _reject_unknown(self, leaves: Sequence[Parameter]) -> None:
        """Reject coefficients that an effect does not have; they would be ignored. A plan may have fewer settings.

        **Raises:** `InputError` with the names that it has.
        """
        for leaf in leaves:
            beginning = f"{leaf.name}_"
            stated = [name for name in self.names if name == leaf.name or name.startswith(beginning)]
            unknown = [name for name in stated if name not in leaf.names and not name.removeprefix(beginning).isdigit()]
            if unknown or not stated:
                fault = f"has no parameter {unknown[0]!r}" if unknown else "is missing"
                raise InputError(f"{self.source}: parameters: {leaf.name} {fault}; give {', '.join(leaf.names)}")

    def priors(self, chain: Chain, where: Where) -> dict[tuple[str, ...], tuple[np.ndarray, np.ndarray]]:
        """Priors of the head on a chain's free parameters: means and covariance by their names; empty if it has none of
        them."""
        pairs = [
            (name, self.names.index(of_head))
            for leaf in chain.free
            for name, of_head in zip(
                leaf.names, pitch_names(leaf, where) if leaf.name == "dbeta" else leaf.names, strict=True
            )
            if of_head in self.names
        ]
        if not pairs:
            return {}
        names, numbers = zip(*pairs, strict=True)
        chosen = np.array(numbers)
        covariance = self.covariance[np.ix_(chosen, chosen)]
        twice = np.array([numbers.count(number) > 1 for number in numbers])
        covariance = covariance + np.diag(np.where(twice, _SAME**2 * np.diag(covariance), 0.0))
        return {names: (self.values[chosen], covariance)}

    def record(self, chain: Chain, where: Where, *, known: bool) -> dict[str, Any]:
        """The entry in the provenance of a calibration; empty if the fitted chain uses none of its errors.

        **Arguments:**

        - `known`: whether the noise of the data is known, as in `extended`.
        """
        present = set[str]()
        for leaf in chain.parameters:
            of_setting = leaf.name == "dbeta" and leaf.free and known
            present |= {*(pitch_names(leaf, where) if of_setting else leaf.names)}
        used = [name for name in self.names if name in present]
        return {"head": HeadRecord.of(self, parameters=used, exact=not known).plain()} if used else {}

    def text(self) -> str:
        """The file's content."""
        scales = np.array([shown(unit)[1] for unit in self.units])
        covariance = self.covariance * np.outer(scales, scales)
        lines = [
            "# Errors of a dividing head, measured by tumblecal diagnose --units. Use it as --head of calibrate and diagnose.",
            "# Directions that the data do not determine are fixed at zero by a very small variance.",
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
    """A head file; `sd` repeats the diagonal of the covariance for readers."""

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

    **Raises:** `InputError` with every fault and its place.
    """
    if path.is_dir():
        inside = path / "head.toml"
        raise InputError(
            f"{path}: a folder; give the file, {inside}"
            if inside.exists()
            else f"{path}: a folder without head.toml; give the file that diagnose --units wrote"
        )
    table = checked(path, read_toml(path), HeadTable)
    units = UNIT_OF_LEAF | dict(effect_units)
    bases = [unit_of_parameter(name, units) for name in table.parameters]
    faults = [f"{path}: {fault}" for fault in (*_sizes(table), *_names(table, links, bases))]
    if faults:
        raise InputError(located(path, faults))
    scales = np.ones(len(bases))
    for number, (unit, base) in enumerate(zip(table.units, bases, strict=True)):
        try:
            scales[number] = factor(unit, base or "1")
        except InputError as error:
            faults.append(f"{path}: units.{number}: {error}")
    covariance = np.array(table.covariance) * np.outer(scales, scales)
    sd = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    positive = np.all(np.diag(covariance) > 0) and np.min(np.linalg.eigvalsh(covariance / np.outer(sd, sd))) > 0
    if not positive or not np.allclose(covariance, covariance.T, rtol=1e-6, atol=0.0):
        faults.append(f"{path}: covariance: not symmetric and positive definite")
    else:
        faults += [f"{path}: {fault}" for fault in _sds(table)]
    if faults:
        raise InputError(located(path, faults))
    return MeasuredHead(
        tuple(table.effects),
        tuple(table.parameters),
        tuple(base or "1" for base in bases),
        np.array(table.values) * scales,
        (covariance + covariance.T) / 2,
        tuple(table.made_of),
        str(path),
        hashlib.sha256(path.read_bytes()).hexdigest(),
    )


def _sizes(table: HeadTable) -> Iterator[str]:
    count = len(table.parameters)
    for name in ("units", "values", "sd", "covariance"):
        if len(given := getattr(table, name)) != count:
            yield f"{name}: {len(given)} entries for {count} parameters"
    for number, row in enumerate(table.covariance):
        if len(row) != count:
            yield f"covariance.{number}: {len(row)} entries for {count} parameters"


def _names(table: HeadTable, links: Collection[str], bases: Sequence[str | None]) -> Iterator[str]:
    yield from (
        f"effects: unknown effect {id!r}; `tumblecal effects` lists them" for id in table.effects if id not in links
    )
    if len(set(table.parameters)) != len(table.parameters):
        yield "parameters: a name is repeated"
    for name, base in zip(table.parameters, bases, strict=True):
        if base is None:
            yield f"parameters: no parameter {name!r} of a head"
        elif name.startswith("dbeta") and not _is_pitch_name(name):
            yield f"parameters: {name!r} is not the name of a pitch setting; write its angle in degrees, such as dbeta@45"


def _sds(table: HeadTable) -> Iterator[str]:
    """Faults of `sd` values that differ from the covariance."""
    made = np.sqrt(np.diag(np.array(table.covariance)))
    for number, (sd, expected) in enumerate(zip(table.sd, made, strict=True)):
        if not abs(sd - expected) <= _ROUNDED * expected:
            yield f"sd.{number}: {sd:g}, but the covariance gives {expected:.4g}; correct the wrong one"
