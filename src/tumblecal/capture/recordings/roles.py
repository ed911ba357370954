"""What the columns of a recording are, and in which units: as asked, as the format says, by their names, or by the numbers."""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tumblecal.capture.protocols.text_layout import roles_of_values
from tumblecal.capture.recordings.column_names import NUMBERS, QUANTITIES, named_quantity, quantity_of, same_kind
from tumblecal.capture.recordings.options import Asked
from tumblecal.capture.recordings.table import SourceTable
from tumblecal.capture.recordings.time_or_temperature import CLOCKS, settled
from tumblecal.capture.recordings.units import (
    FORCE,
    RATE,
    Column,
    check_units,
    first_cell,
    force_unit,
    numbers_of,
    rate_unit,
    time_unit,
    unread,
)
from tumblecal.data.cells import advice
from tumblecal.data.text_layout import ROW
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown


if TYPE_CHECKING:
    import polars as pl


@dataclass(frozen=True)
class Layout:
    """What is taken of a table.

    **Arguments:**

    - `columns`: by quantity (`ax` .. `gz`, `time`, `temperature`, `position` ...).
    - `per_g`: counts a g, where readings are counts and that is known; `said`: what was guessed, in words.
    """

    table: SourceTable
    columns: Mapping[str, Column]
    per_g: float | None
    size: float
    said: tuple[str, ...]

    @property
    def unit(self) -> str:
        """Of the accelerations: g, mg, ms2 or counts."""
        return self.columns["ax"].unit


def has_force(table: SourceTable, asked: Asked) -> bool:
    """Whether a table has the three accelerations by name, as asked or as its format says."""
    return set(FORCE) <= set(_named(table, asked))


def layout_of(table: SourceTable, asked: Asked, path: str, only: Collection[str] | None = None) -> Layout:
    """Settle what the columns are; of those that are not asked for, `only` some quantities, where given.

    **Raises:** `InputError` when the three accelerations are not among them, or for options that fit nothing.
    """
    named = _named(table, asked)
    first = next(iter(table.pieces(_numeric_first(table, named))), None)
    if first is None or not len(first):
        raise InputError(f"{path}: no rows")
    said = list[str]()
    if not set(FORCE) & set(named):
        named |= _by_values(table, first)
        said += [f"columns by their values: {', '.join(f'{role}={column.name}' for role, column in named.items())}"]
    if only is not None:
        only = {*only, *_asked_for(table, asked)}
        # A column `t` is told by the time or the temperature beside it.
        named = _of(named, only | CLOCKS if only & CLOCKS else only)
    named, words = settled(named, first, path)
    named = named if only is None else _of(named, only)
    said += words
    lacking = [role for role in FORCE if role not in named]
    if lacking:
        raise InputError(
            f"{path}: {', '.join(lacking)} not found among the columns {shown(', '.join(table.columns))}; say which they "
            "are: --columns ax=...,ay=...,az=..."
        )
    check_units(table, named, asked, path)
    named, words = _readable(table, named, asked, first, path)
    said += words
    named = _scaled(named, asked)
    force = np.stack([numbers_of(first, named[role]) for role in FORCE], axis=1)
    lengths = np.linalg.norm(force, axis=1)
    if np.isnan(lengths).all():
        there = ", ".join(named[role].name for role in FORCE)
        raise InputError(f"{path}: no row holds a number in each of {there}; another layout; give --columns")
    size = float(np.nanmedian(lengths))
    named, per_g, words = force_unit(table, named, asked, size)
    named, gyro = rate_unit(table, named, asked)
    if "time" in named:
        named, clock = time_unit(table, named, asked, first, path)
        words = [*words, *clock]
    return Layout(table, named, per_g, size, (*said, *words, *gyro))


def _of(named: Mapping[str, Column], roles: Collection[str]) -> dict[str, Column]:
    return {role: column for role, column in named.items() if role in roles}


def _readable(
    table: SourceTable, named: dict[str, Column], asked: Asked, first: "pl.DataFrame", path: str
) -> tuple[dict[str, Column], list[str]]:
    """The columns that hold numbers, or should not, and what is to be said of those left out.

    **Raises:** `InputError` for accelerations, angles, and columns asked for, that hold none.
    """
    numeric = [role for role in (*FORCE, *RATE, "temperature", *NUMBERS) if role in named]
    unreadable = [role for role in numeric if not np.isfinite(numbers_of(first, named[role])).any()]
    said = list[str]()
    for role in unreadable:
        # What a device does not send stands as empty columns in some formats; of a column of words it is said.
        cell, of_words = first_cell(first, named[role]), not _numeric_or_empty(first, named[role])
        if role in (*FORCE, *_asked_for(table, asked)) or (role in NUMBERS and of_words):
            more = ", or give --columns" if role in FORCE else ""
            raise InputError(f"{path}:{unread(table, first, named[role])}: no number; {advice(cell, role)}{more}")
        said += [f"{unread(table, first, named[role])}: no number; left out as {role}"] * of_words
    return {role: column for role, column in named.items() if role not in unreadable}, said


def _named(table: SourceTable, asked: Asked) -> dict[str, Column]:
    """Columns by their quantity, by name alone; what the user says goes before what the format and the names say."""
    asked_for = _asked_for(table, asked)
    taken = {column.name for column in asked_for.values()}
    named: dict[str, Column] = {}
    for name in table.columns:
        quantity, unit = named_quantity(table, name)
        if quantity and quantity not in named and name not in taken:
            named[quantity] = Column(name, unit)
    return named | asked_for


def _asked_for(table: SourceTable, asked: Asked) -> dict[str, Column]:
    """The columns that a user names.

    **Raises:** `InputError` for a quantity or a column that there is not.
    """
    asked_for: dict[str, Column] = {}
    for role, given in _pairs(asked.columns, "--columns").items():
        quantity, unit = quantity_of(role)
        said = f"--columns {role}={given}"
        if quantity not in QUANTITIES:
            raise InputError(f"{said}: no such quantity; there are {', '.join(QUANTITIES)}")
        name = _column_asked_for(table, given, said)
        taken = next((other for other, own in asked_for.items() if own.name == name or other == quantity), None)
        if taken is not None:
            other = f"column {asked_for[taken].name} is {taken} already"
            raise InputError(f"{said}: {other}; name another column for each quantity")
        # Where the user says no unit, the column's own name may.
        own_quantity, own_unit = named_quantity(table, name)
        unit = unit or (own_unit if same_kind(own_quantity, quantity) else "")
        asked_for[quantity] = Column(name, unit)
    return asked_for


def _column_asked_for(table: SourceTable, given: str, said: str) -> str:
    """The name of a column that is asked for by its name or its number."""
    if given in table.columns:
        return given
    number = int(given) if given.isdecimal() else 0
    if not 1 <= number <= len(table.columns):
        raise InputError(f"{said}: no such column; the recording has {shown(', '.join(table.columns))}")
    return table.columns[number - 1]


def _numeric_or_empty(first: "pl.DataFrame", column: Column) -> bool:
    cells = first[column.name]
    return cells.dtype.is_numeric() or not any(str(cell).strip() for cell in cells.drop_nulls())


def _pairs(text: str, option: str) -> dict[str, str]:
    pairs = {}
    for part in filter(None, text.split(",")):
        key, equals, value = part.partition("=")
        if not equals or not value.strip():
            raise InputError(f"{option} {text}: write pairs such as ax=AccX,ay=AccY,az=AccZ")
        if pairs.get(key.strip(), value.strip()) != value.strip():
            raise InputError(f"{option} {text}: {key.strip()} is given twice; keep one")
        pairs[key.strip()] = value.strip()
    return pairs


def _per_axis(text: str, option: str, default: float) -> dict[str, float]:
    """A finite number for all accelerations, or one for each quantity named; of scales none is 0."""
    pairs = _pairs(text, option) if "=" in text else dict.fromkeys(FORCE, text or str(default))
    numbers = {}
    for role, value in pairs.items():
        try:
            numbers[role] = float(value)
        except ValueError:
            raise InputError(f"{option} {text}: not a number; write 0.5, or ax=0.5,ay=0.4,az=0.5") from None
        if not np.isfinite(numbers[role]) or (default and not numbers[role]):
            raise InputError(f"{option} {text}: must be finite{' and other than 0' if default else ''}")
    return numbers


def _scaled(named: dict[str, Column], asked: Asked) -> dict[str, Column]:
    scale, offset = _per_axis(asked.scale, "--scale", 1.0), _per_axis(asked.offset, "--offset", 0.0)
    unknown = [role for role in (*scale, *offset) if role not in named]
    if unknown:
        raise InputError(f"--scale, --offset: {unknown[0]} is not among the columns; there are {', '.join(named)}")
    return {
        role: Column(column.name, column.unit, scale.get(role, 1.0), offset.get(role, 0.0))
        for role, column in named.items()
    }


def _numeric_first(table: SourceTable, named: Mapping[str, Column]) -> list[str]:
    return [column.name for column in named.values()] if set(FORCE) & set(named) else list(table.columns)


def _by_values(table: SourceTable, first: "pl.DataFrame") -> dict[str, Column]:
    """The first triple of one g is the force, a triple behind it the rate; what only rises is a time."""
    columns = [name for name in table.columns if first[name].dtype.is_numeric() and name != ROW]
    values = np.stack([numbers_of(first, Column(name)) for name in columns], axis=1) if columns else np.zeros((0, 0))
    values = values[np.isfinite(values).all(1)]
    if len(values) < 8 or values.shape[1] < 3:
        return {}
    roles = roles_of_values(values, ["-"] * len(columns))
    # A last column that has a name, and not that of a temperature, is none.
    names = {"t": "" if re.search("[A-Za-z]", columns[-1]) else "temperature"}
    return {
        names.get(role, role): Column(name)
        for role, name in zip(roles, columns, strict=True)
        if names.get(role, role) in QUANTITIES
    }
