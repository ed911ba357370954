"""The quantities of the columns of a recording, from its first rows."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.data.cells import advice
from tumblecal.data.column_names import FORCE, NUMBERS, RATE, parsed, role_of
from tumblecal.data.text_layout import ROW
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown
from tumblecal.recordings.choice import chosen
from tumblecal.recordings.clock import FORMS, TIME_S, form_of, rises, seconds_of, unit_of_times
from tumblecal.recordings.columns import COLUMNS_OPTION, Column, Layout, given_columns, pairs, stated_rate
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.table import Table
from tumblecal.recordings.units import (
    FORCE_UNITS,
    RATE_UNITS,
    check_one_unit,
    force_unit,
    rate_unit,
    signed_words,
    size_of,
)


_CLOCK_ROWS, _EQUAL_STEPS, _DEGC = 1000, 0.8, (-60.0, 150.0)


def layout_of(
    table: Table,
    first: pl.DataFrame,
    options: RecordingOptions,
    path: str,
    notes: list[str],
    only: Collection[str] | None = None,
) -> Layout:
    """The quantities and units of the columns of a table.

    **Arguments:**

    - `first`: the first rows. `notes`: gets what is assumed, also before an error that may follow from it.
    - `only`: the quantities that are needed, if no option names others.

    **Raises:** `InputError` if the accelerations, a unit or the clock are not stated, with an option that can be pasted.
    """
    columns = given_columns(table, options)
    free = [name for name in table.columns if name not in {one.name for one in columns.values()} and name != ROW]

    def readings(names: Sequence[str]) -> NDArray[np.float64]:
        one = [Column(name, bits=options.signed or 0) for name in names]
        return (
            np.stack([column.numbers(table, first) for column in one], axis=1) if names else np.zeros((len(first), 0))
        )

    if not {*FORCE} & {*columns}:
        force, rate, on_choice = chosen(free, readings, path)
        notes += on_choice
        for roles, triple in ((FORCE, force), (RATE, rate)):
            for role, name in zip(roles, triple.columns if triple else (), strict=False):
                columns[role] = Column(name, parsed(name).unit, "name")
    letters = only is None or bool({"time", "temperature"} & {*only})
    columns |= _others(
        table, first, columns, free if letters else [name for name in free if not _is_letter_t(name)], notes, path
    )
    lacking = [role for role in FORCE if role not in columns]
    if lacking:
        raise InputError(
            f"{path}: {', '.join(lacking)} not found among the columns {shown(', '.join(table.columns))}; name them: "
            f"{COLUMNS_OPTION}"
        )
    if only is not None:
        columns = {role: column for role, column in columns.items() if role in only or column.why.startswith("option")}
    columns = _readable(table, first, columns, options, path, notes)
    columns = _scaled(columns, options)
    values = np.stack([columns[role].numbers(table, first) for role in FORCE], axis=1)
    size, changes, dispersion = size_of(values)
    if not np.isfinite(size):
        there = ", ".join(columns[role].name for role in FORCE)
        raise InputError(
            f"{path}: no row has a number in each of {there}; give the columns of the accelerations by --columns"
        )
    for roles, known in ((FORCE, FORCE_UNITS), (RATE, RATE_UNITS)):
        check_one_unit(table, columns, roles, options.unit if known is FORCE_UNITS else options.gyro_unit, path)
    if not options.signed and (words := signed_words([columns[role].name for role in FORCE], values)):
        raise InputError(f"{path}: {words}")
    columns, per_g = force_unit(table, columns, options, size, notes, without_bias=dispersion < changes)
    columns = rate_unit(table, columns, options, notes)
    if "time" in columns:
        columns = _clock(table, first, columns, options, path, notes)
    return Layout(columns, per_g, size, tuple(notes))


def _others(
    table: Table, first: pl.DataFrame, columns: Mapping[str, Column], free: Sequence[str], notes: list[str], path: str
) -> dict[str, Column]:
    """Time, temperature, labels, angles, and single axes by the names of unassigned columns; of several times, the one whose
    name has the fewest other words, if its values can be times."""
    used = {column.name for column in columns.values()}
    free = sorted((name for name in free if name not in used), key=lambda name: parsed(name).foreign)
    others: dict[str, Column] = {}
    clocks: list[str] = []
    for name in free:
        role, unit = role_of(name)
        if role == "time":
            clocks.append(name)
        elif role and role not in columns:
            other_rate = role in RATE and (parsed(name).quantity != "rate" or bool({*RATE} & {*columns}))
            if not other_rate and not (role in FORCE and {*FORCE} <= {*columns}):
                others.setdefault(role, Column(name, unit, "name"))
    if "time" not in columns:
        usable = [name for name in clocks if _may_be_times(table, first, name)]
        # A unit or a date says what a number without one does not.
        usable.sort(key=lambda name: not (parsed(name).unit or form_of(_cells(first, name))))
        if parted := _parted(table, first, clocks, usable):
            others["time"] = parted
        elif usable or clocks:
            others["time"] = Column((usable or clocks)[0], parsed((usable or clocks)[0]).unit, "name")
        elif dated := [name for name in free if form_of(_cells(first, name))]:
            others["time"] = Column(dated[0], "", "dates")
    alone = [name for name in free if _is_letter_t(name) and name not in {column.name for column in others.values()}]
    both = {"time", "temperature"} & {*columns, *others}
    for name in sorted(alone, key=lambda name: name.strip()[0], reverse=True):  # t before T
        role = _time_or_temperature(table, first, name)
        if role in both or not role:
            words = f"column {name} may be the time or the temperature"
            if not both:
                raise InputError(f"{path}: {words}; give --columns time={name} or --columns temperature={name}")
            role = "time" if "temperature" in both and "time" not in both else ""
            notes += [] if role else [f"{words}: not used (to use it: --columns temperature={name})"]
        if role:
            both.add(role)
            others[role] = Column(name, "", "values")
            notes.append(f"column {name} is the {role}, by its values; to override: --columns {role}=...")
    return others


def _time_or_temperature(table: Table, first: pl.DataFrame, name: str) -> str:
    """Time for dates and numbers that rise in nearly equal steps, temperature for numbers that also fall; empty if unclear."""
    values = Column(name).numbers(table, first)
    steps = np.diff(values[np.isfinite(values)])
    if not len(steps):
        return "time" if form_of(_cells(first, name)) else ""
    equal = float(np.mean(np.abs(steps - np.median(steps)) <= 0.5 * abs(np.median(steps)))) >= _EQUAL_STEPS
    if rises(values):
        return "time" if equal and len(steps) > 2 else ""
    return "temperature" if _DEGC[0] < np.nanmin(values) and np.nanmax(values) < _DEGC[1] else ""


def _is_letter_t(name: str) -> bool:
    """Whether a name is a `t` alone, also with the unit degree: the time or the temperature."""
    meaning = parsed(name)
    return meaning.stem == ("t",) and not meaning.axis and meaning.quantity in ("", "orientation")


def _may_be_times(table: Table, first: pl.DataFrame, name: str) -> bool:
    kind = first[name].dtype
    if form_of(_cells(first, name)):
        return True
    return rises(Column(name).numbers(table, first)) if kind == pl.String or kind.is_numeric() else len(first) > 0


def _cells(first: pl.DataFrame, name: str) -> list[str]:
    """The first cells of a column of text; none of other columns."""
    return first[name].drop_nulls().head(100).to_list() if first[name].dtype == pl.String else []


def _parted(table: Table, first: pl.DataFrame, clocks: Sequence[str], usable: Sequence[str]) -> Column | None:
    """A clock in two columns: whole seconds, and their fraction in ms, us or ns by the names."""
    whole, parts = "", None
    for name in clocks if len(clocks) > 1 else ():
        scale, values = TIME_S.get(parsed(name).unit, 0.0), Column(name).numbers(table, first)
        values = values[np.isfinite(values)]
        if scale == 1 and len(values) and (values == np.round(values)).all():
            whole = whole or name
        elif 0 < scale < 1 and len(values) and values.min() >= 0 and np.ptp(values) > 0 and values.max() < 1 / scale:
            parts = parts or Column(name, "s", "name", scale)
    if not whole or parts is None or [name for name in usable if name not in (whole, parts.name)]:
        return None
    return replace(parts, whole=whole)


def _readable(
    table: Table,
    first: pl.DataFrame,
    columns: dict[str, Column],
    options: RecordingOptions,
    path: str,
    notes: list[str],
) -> dict[str, Column]:
    """The columns that have numbers or need none.

    **Raises:** `InputError` for accelerations, angles, and columns named by an option, without any number.
    """
    for role in (*FORCE, *RATE, "temperature", *NUMBERS):
        column = columns.get(role)
        if column is None or np.isfinite(column.numbers(table, first)).any():
            continue
        cells = first.filter(pl.col(column.name).cast(pl.String).str.strip_chars().fill_null("") != "").head(1)
        cell = cells[column.name].cast(pl.String)[0] if len(cells) and not cells[column.name].dtype.is_numeric() else ""
        row = f"{table.row_word} {cells[ROW][0]}, " if cell and ROW in cells.columns else ""
        words = f"{row}column {column.name}: {f'{shown(cell)}: no number' if cell else 'every cell is empty or NaN'}"
        if role in FORCE or column.why.startswith("option") or (cell and role in NUMBERS):
            comma = re.fullmatch(r"[+-]?\d*,\d+(e[+-]?\d+)?", cell.strip(), re.IGNORECASE)
            cure = "its comma may be decimal: --decimal comma" if comma else f"{advice(cell, role)}, or give --columns"
            raise InputError(f"{path}:{words}; {cure}")
        notes += [f"{words}; ignored as {role}"] * bool(cell)
        columns = {name: other for name, other in columns.items() if name != role}
    return columns


def _scaled(columns: Mapping[str, Column], options: RecordingOptions) -> dict[str, Column]:
    """The columns with the scales, offsets and bits of the options."""
    scale, offset = _per_axis(options.scale, "--scale", 1.0), _per_axis(options.offset, "--offset", 0.0)
    if unknown := [role for role in (*scale, *offset) if role not in columns]:
        raise InputError(f"--scale, --offset: {unknown[0]} is not among the columns; there are {', '.join(columns)}")
    return {
        role: replace(
            column,
            scale=scale.get(role, column.scale),
            offset=offset.get(role, column.offset),
            bits=(options.signed or 0) if role in (*FORCE, *RATE) else 0,
        )
        for role, column in columns.items()
    }


def _per_axis(text: str, option: str, default: float) -> dict[str, float]:
    """A finite number for all accelerations, or one for each named quantity; a scale must not be 0."""
    try:
        given = pairs(text, option) if "=" in text else dict.fromkeys(FORCE, text or str(default))
        numbers = {role: float(value) for role, value in given.items()}
    except ValueError:
        raise InputError(f"{option} {text}: not a number; write 0.5, or ax=0.5,ay=0.4,az=0.5") from None
    if not all(np.isfinite(value) and (value or not default) for value in numbers.values()):
        raise InputError(f"{option} {text}: must be finite{' and other than 0' if default else ''}")
    return numbers


def _clock(
    table: Table,
    first: pl.DataFrame,
    columns: dict[str, Column],
    options: RecordingOptions,
    path: str,
    notes: list[str],
) -> dict[str, Column]:
    """The columns with the form and unit of the clock.

    **Raises:** `InputError` for times that cannot be read, or whose unit is not stated.
    """
    column = columns["time"]
    if options.time_unit and options.time_unit not in TIME_S:
        raise InputError(f"--time-unit {options.time_unit}: not known; write one of s, ms, us, ns")
    cells = first[column.name].drop_nulls()
    without = {role: other for role, other in columns.items() if role != "time"}
    if column.whole:
        return columns
    if isinstance(cells.dtype, pl.Datetime | pl.Duration | pl.Time) and len(cells):
        scale = TIME_S[getattr(cells.dtype, "time_unit", "ns")]
        return columns | {"time": replace(column, unit="s", scale=scale, offset=float(cells.to_physical()[0]))}
    texts = pl.concat([cells.head(_CLOCK_ROWS), cells.tail(_CLOCK_ROWS)]).to_list() if cells.dtype == pl.String else []
    if form := form_of(texts):
        begin = first.select(seconds_of(column.name, form)).to_series().drop_nulls()
        day = float(begin[0] // 86400) if len(begin) and "<year>" in FORMS[form] else 0.0
        return columns | {"time": replace(column, unit="s", form=form, offset=day)}
    if not len(cells):
        notes.append(f"column {column.name} is empty: ignored")
        return without
    times = column.numbers(table, first)
    if not np.isfinite(times).any() or cells.dtype == pl.Date:
        words = f"column {column.name}: {shown(str(cells[0]))} cannot be read as a time"
        if options.rate:
            notes.append(f"{words}: ignored, --rate is used")
            return without
        raise InputError(
            f"{path}: {words}; write seconds, h:m:s.f or dates such as 2026-03-29T01:59:30.010, or give --rate 100 to omit it"
        )
    unit, note = unit_of_times(
        times, column.name, options.time_unit or column.unit, options.rate or stated_rate(table), path
    )
    notes += [note] if note else []
    if not unit:
        return without
    return columns | {"time": replace(column, unit="s", scale=TIME_S[unit])}
