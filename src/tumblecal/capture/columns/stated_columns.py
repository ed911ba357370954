"""The columns that options name, with their scales and offsets, and those that the format names."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import polars as pl

from tumblecal.capture.columns.column_names import QUANTITIES, ColumnName, exact_role, role_of, same_kind
from tumblecal.capture.columns.number_range import Wrap
from tumblecal.capture.columns.triples import triples_of
from tumblecal.capture.columns.units import FORCE, Column, numbers_of, per_g_of, wraps_of
from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.capture.recordings.table import SourceTable
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown


def given_columns(table: SourceTable, options: RecordingOptions) -> dict[str, Column]:
    """Columns by quantity: from options first, then from the format or the names that this program writes."""
    stated = columns_of_option(table, options)
    used = {column.name for column in stated.values()}
    given: dict[str, Column] = {}
    for name in table.columns:
        role, unit = exact_role(table.roles.get(name, ""))
        if role and role not in given and name not in used:
            given[role] = Column(name, unit)
    return given | stated


def columns_of_option(table: SourceTable, options: RecordingOptions) -> dict[str, Column]:
    """The columns of the option `--columns`.

    **Raises:** `InputError` for an unknown quantity, or a column that does not exist.
    """
    columns: dict[str, Column] = {}
    for role, given in _pairs(options.columns, "--columns").items():
        quantity, unit = exact_role(role)
        option = f"--columns {role}={given}"
        if quantity not in QUANTITIES:
            raise InputError(f"{option}: no such quantity; there are {', '.join(QUANTITIES)}")
        name = _column_of_option(table, given, option)
        other_quantity = next(
            (other for other, column in columns.items() if column.name == name or other == quantity), None
        )
        if other_quantity is not None:
            other = f"column {columns[other_quantity].name} is {other_quantity} already"
            raise InputError(f"{option}: {other}; name another column for each quantity")
        # If the option gives no unit, the name of the column may give it.
        named_quantity, named_unit = exact_role(table.roles[name]) if name in table.roles else role_of(name)
        unit = unit or (named_unit if same_kind(named_quantity, quantity) else "")
        columns[quantity] = Column(name, unit)
    return columns


def _column_of_option(table: SourceTable, given: str, option: str) -> str:
    """The name of a column that the option gives by name or number."""
    if given in table.columns:
        return given
    number = int(given) if given.isdecimal() else 0
    if not 1 <= number <= len(table.columns):
        raise InputError(f"{option}: no such column; the recording has {shown(', '.join(table.columns))}")
    return table.columns[number - 1]


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


def per_axis(text: str, option: str, default: float) -> dict[str, float]:
    """A finite number for all accelerations, or one for each named quantity; a scale must not be 0."""
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


def scaled(named: dict[str, Column], options: RecordingOptions) -> dict[str, Column]:
    """The columns with the scales and offsets from the options.

    **Raises:** `InputError` for a scale or an offset of a quantity without a column.
    """
    scale, offset = per_axis(options.scale, "--scale", 1.0), per_axis(options.offset, "--offset", 0.0)
    unknown = [role for role in (*scale, *offset) if role not in named]
    if unknown:
        raise InputError(f"--scale, --offset: {unknown[0]} is not among the columns; there are {', '.join(named)}")
    return {
        role: replace(column, scale=scale.get(role, column.scale), offset=offset.get(role, column.offset))
        for role, column in named.items()
    }


def readings_of(
    names: Mapping[str, ColumnName], first: pl.DataFrame, options: RecordingOptions
) -> Callable[[str, int], np.ndarray]:
    """A function for the numbers of a column on an axis, with the scale and the offset from the options, corrected into the
    range of their type by the triples of names."""
    scale, offset = per_axis(options.scale, "--scale", 1.0), per_axis(options.offset, "--offset", 0.0)
    wraps = dict[str, Wrap]()
    for triple in triples_of({name: meaning for name, meaning in names.items() if name in first.columns}):
        columns = {
            role: Column(name, "", scale.get(role, 1.0)) for role, name in zip(FORCE, triple.columns, strict=True)
        }
        found = wraps_of(columns, first, per_g_of(options.unit))
        wraps |= {columns[role].name: wrap for role, wrap in found.items() if wrap}

    def readings(name: str, axis: int) -> np.ndarray:
        column = Column(name, "", scale.get(FORCE[axis], 1.0), offset.get(FORCE[axis], 0.0), wraps.get(name))
        return numbers_of(first, column)

    return readings
