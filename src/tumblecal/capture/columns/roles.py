"""Quantities and units of the columns of a recording: by option, by the format, by name, or by value."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import islice
from types import MappingProxyType

import numpy as np
import polars as pl

from tumblecal.capture.columns.clock_column import clock_by_name, clock_by_values, settled
from tumblecal.capture.columns.column_choice import Unsettled, chosen
from tumblecal.capture.columns.column_names import CLOCKS, EITHER, NUMBERS, ColumnName, parsed, role_of
from tumblecal.capture.columns.number_range import Wrap
from tumblecal.capture.columns.stated_columns import columns_of_option, given_columns, readings_of, scaled
from tumblecal.capture.columns.triples import ALIKE, Columns, triples_of, usual_unit
from tumblecal.capture.columns.units import (
    FORCE,
    RATE,
    Column,
    check_units,
    first_cell,
    force_unit,
    in_range,
    numbers_of,
    per_g_of,
    rate_unit,
    time_unit,
    unread,
)
from tumblecal.capture.recordings.guesses import guessed
from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.capture.recordings.table import SourceTable
from tumblecal.capture.rows.row_runs import without_erased_rows
from tumblecal.data.cells import advice
from tumblecal.data.gravity_size import power_of_two
from tumblecal.data.text_layout import ROW
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import UNITS_PER_G
from tumblecal.ground.text_file import shown


# At most this many pieces of a file without names are read until the values show the accelerations.
_MOST_PIECES = 16
# Readings larger than one g by this factor have a different unit from the one in their name.
_FAR = 3.0


@dataclass(frozen=True)
class ColumnLayout:
    """The columns of a table with their quantities and units.

    **Arguments:**

    - `columns`: columns by quantity (`ax` .. `gz`, `time`, `temperature`, `position` ...).
    - `per_g`: counts for one g, if readings are counts and it is known. `size`: approximate size of gravity in them.
    - `guesses`: the guesses, in words. `why`: evidence for each column.
    """

    table: SourceTable
    columns: Mapping[str, Column]
    per_g: float | None
    size: float
    guesses: tuple[str, ...]
    why: Mapping[str, str]

    @property
    def unit(self) -> str:
        """Unit of the accelerations: g, mg, ms2 or counts."""
        return self.columns["ax"].unit


def has_force(table: SourceTable, options: RecordingOptions) -> bool:
    """Whether a table has three accelerations by option, by its format or by name."""
    given = given_columns(table, options)
    if set(FORCE) <= set(given):
        return True
    return any(triple.name.quantity == "acceleration" for triple in triples_of(_free_names(table, given)))


def layout_of(
    table: SourceTable,
    options: RecordingOptions,
    path: str,
    only: Collection[str] | None = None,
    wraps: Mapping[str, Wrap] = MappingProxyType({}),
) -> ColumnLayout:
    """Determine the quantities and units of the columns.

    **Arguments:**

    - `only`: if given, columns that no option names are restricted to these quantities.
    - `wraps`: corrections of numbers outside the range of their type, if known.

    **Raises:** `InputError` if the three accelerations are not among them, or for options that fit nothing. The command
    prints the guesses first.
    """
    given = given_columns(table, options)
    names = _free_names(table, given)
    pieces = iter(table.pieces(_needed(table, given, names)))
    first = next(pieces, None)
    if first is None or not len(first):
        raise InputError(f"{path}: no rows")
    read = 1
    while True:
        guesses = list[str]()
        try:
            with guessed(guesses):
                return _layout(table, options, (path, only), (given, names, without_erased_rows(first)), guesses, wraps)
        except Unsettled:
            more = [] if read >= _MOST_PIECES else list(islice(pieces, read))
            if not more:
                raise
            for piece in more:
                first = first.vstack(piece)
            read *= 2


def _layout(
    table: SourceTable,
    options: RecordingOptions,
    wanted: tuple[str, Collection[str] | None],
    found: tuple[dict[str, Column], dict[str, ColumnName], pl.DataFrame],
    guesses: list[str],
    wraps: Mapping[str, Wrap],
) -> ColumnLayout:
    (path, only), (given, names, first) = wanted, found
    why = {role: "asked for" if role in columns_of_option(table, options) else "format" for role in given}
    named, fitted = dict(given), None
    if not set(FORCE) & set(given):
        choice = chosen(Columns(table.columns, names, readings_of(names, first, options), per_g_of(options.unit)), path)
        if choice is not None:
            fitted = choice.size
            guesses += choice.guesses
            for roles, triple, reason in ((FORCE, choice.force, choice.why), (RATE, choice.rate, choice.rate_why)):
                if triple is not None:
                    new = {
                        role: Column(name, names[name].unit) for role, name in zip(roles, triple.columns, strict=True)
                    }
                    named, why = named | new, why | dict.fromkeys(new, reason)
    for role, column in _others(table, names, named, first).items():
        named.setdefault(role, column)
        why.setdefault(role, "name")
    if not {"time", *EITHER} & set(named):
        assigned = {column.name for column in named.values()}
        unnamed = {
            name: meaning
            for name, meaning in names.items()
            if meaning.quantity in ("", "other") and name not in assigned
        }
        nameless = not any(name.quantity for name in names.values())
        if clock := clock_by_values(first, unnamed, nameless=nameless):
            named["time"], why["time"] = Column(clock), "values"
            guesses.append(f"time: column {clock}, by its values (it only rises); to override: --columns time=...")
    if only is not None:
        only = {*only, *columns_of_option(table, options)}
        # The other of time and temperature shows the quantity of a column `t`.
        named = _of(named, only | CLOCKS if only & CLOCKS else only)
    named, words = settled(named, first, path)
    named = named if only is None else _of(named, only)
    guesses += words
    lacking = [role for role in FORCE if role not in named]
    if lacking:
        raise InputError(
            f"{path}: {', '.join(lacking)} not found among the columns {shown(', '.join(table.columns))}; name them: "
            "--columns ax=...,ay=...,az=..."
        )
    check_units(table, named, options, path)
    named, words = _readable(table, named, options, first, path)
    guesses += words
    named = in_range(table, scaled(named, options), options, first, wraps)
    force = np.stack([numbers_of(first, named[role]) for role in FORCE], axis=1)
    lengths = np.linalg.norm(force, axis=1)
    # Erased memory and sensors that do not answer have one number on all axes, which does not show the unit.
    if (different := np.ptp(force, axis=1) > 0).any():
        lengths[~different] = np.nan
    if np.isnan(lengths).all():
        there = ", ".join(named[role].name for role in FORCE)
        raise InputError(
            f"{path}: no row has a number in each of {there}; give the columns of the accelerations by --columns"
        )
    size = float(np.nanmedian(lengths)) if fitted is None or options.scale or options.offset else fitted
    stated = {role: column.unit for role, column in named.items()}
    named, per_g, by_size = force_unit(table, named, options, size)
    named, words = rate_unit(table, named, options)
    guesses += [*by_size, *words, *_other_unit(named, options, size)]
    if "time" in named:
        if named["time"].whole:
            guesses.append(
                f"time: columns {named['time'].whole} (whole seconds) and {named['time'].name}; --columns time=..."
            )
        named, words = time_unit(table, named, options, first, path)
        guesses += words
    why = {role: f"{why.get(role, 'name')}{_unit_why(role, stated, options, bool(by_size))}" for role in named}
    return ColumnLayout(table, named, per_g, size, tuple(guesses), why)


def _other_unit(named: Mapping[str, Column], options: RecordingOptions, size: float) -> list[str]:
    """A message if the unit in the names contradicts the size of the readings, which is one g in a different unit."""
    per_g, other = per_g_of(named["ax"].unit), usual_unit(size, ALIKE)
    if options.unit or per_g is None or other is None or 1 / _FAR < size / per_g < _FAR:
        return []
    if abs(np.log(size / per_g / power_of_two(size / per_g))) < abs(np.log(size / UNITS_PER_G[other])):
        return []  # a wrong full-scale range explains it better
    return [
        f"unit by name: {named['ax'].unit}, but the readings' size is about {size:.5g}, one g in {other}; to change it: --unit"
    ]


def _unit_why(role: str, stated: Mapping[str, str], options: RecordingOptions, by_size: bool) -> str:
    """The evidence for the unit of a quantity, in words; empty for a quantity without a unit."""
    kinds = (
        (FORCE, options.unit, "by size" if by_size else "by the format, or not known"),
        (RATE, options.gyro_unit, "not known"),
        (("time",), options.time_unit, "by the rate, or as a clock"),
    )
    for roles, given, otherwise in kinds:
        if role in roles:
            by_name = any(stated.get(one) for one in roles)
            return f"; unit: {'asked for' if given else 'by name' if by_name else otherwise}"
    return ""


def _of(named: Mapping[str, Column], roles: Collection[str]) -> dict[str, Column]:
    return {role: column for role, column in named.items() if role in roles}


def _readable(
    table: SourceTable, named: dict[str, Column], options: RecordingOptions, first: pl.DataFrame, path: str
) -> tuple[dict[str, Column], list[str]]:
    """The columns that have numbers or need none, and messages about ignored columns.

    **Raises:** `InputError` for accelerations, angles, and columns named by an option, without any number.
    """
    numeric = [role for role in (*FORCE, *RATE, "temperature", *NUMBERS) if role in named]
    unreadable = [role for role in numeric if not np.isfinite(numbers_of(first, named[role])).any()]
    messages = list[str]()
    for role in unreadable:
        # Some formats have empty columns for quantities that the device does not send; only a column of words is reported.
        cell, of_words = first_cell(first, named[role]), not _numeric_or_empty(first, named[role])
        if role in (*FORCE, *columns_of_option(table, options)) or (role in NUMBERS and of_words):
            more = ", or give --columns" if role in FORCE else ""
            raise InputError(f"{path}:{unread(table, first, named[role])}: no number; {advice(cell, role)}{more}")
        messages += [f"{unread(table, first, named[role])}: no number; ignored as {role}"] * of_words
    return {role: column for role, column in named.items() if role not in unreadable}, messages


def _needed(table: SourceTable, given: Mapping[str, Column], names: Mapping[str, ColumnName]) -> list[str]:
    """The columns whose values may be needed: if a name is that of an acceleration, only columns named as readings or times."""
    if not any(triple.name.quantity == "acceleration" for triple in triples_of(names)) and not set(FORCE) <= set(given):
        return list(table.columns)
    read = ("acceleration", "rate", "letter", "time", "temperature")
    if not any(role_of(name)[0] in CLOCKS for name in names):
        # The clock is searched among columns whose names have no known word.
        read = (*read, "", "other")
    assigned = {column.name for column in given.values()}
    return [
        name
        for name in table.columns
        if name in assigned or (name in names and (names[name].quantity in read or role_of(name)[0]))
    ]


def _free_names(table: SourceTable, given: Mapping[str, Column]) -> dict[str, ColumnName]:
    """Meanings of the names of columns that neither an option nor the format assigns."""
    assigned = {column.name for column in given.values()}
    return {name: parsed(name) for name in table.columns if name not in assigned and name != ROW}


def _others(
    table: SourceTable, names: Mapping[str, ColumnName], named: Mapping[str, Column], first: pl.DataFrame
) -> dict[str, Column]:
    """Time, temperature, labels, angles, and single axes, by the names of unassigned columns. Of several times, the one whose
    name has the fewest other words, if its values can be times."""
    assigned = {column.name for column in named.values()}
    others: dict[str, Column] = {}
    for name in sorted(names, key=lambda name: names[name].foreign):
        role, unit = role_of(name)
        if role is None or role in others or name in assigned:
            continue
        if (role in FORCE and set(FORCE) <= set(named)) or (
            role in RATE and (set(RATE) & set(named) or names[name].quantity != "rate")
        ):
            continue
        others[role] = Column(name, unit)
    clock = clock_by_name(first, {name: meaning for name, meaning in names.items() if name not in assigned})
    return others | ({"time": clock} if clock else {})


def _numeric_or_empty(first: pl.DataFrame, column: Column) -> bool:
    cells = first[column.name]
    return cells.dtype.is_numeric() or not any(str(cell).strip() for cell in cells.drop_nulls())
