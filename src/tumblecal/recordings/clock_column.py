"""The column of the clock of a recording, by its name or its dates, with its form and unit."""

import shlex
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import polars as pl

from tumblecal.data.column_names import parsed, role_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown
from tumblecal.recordings.clock import (
    DAY_S,
    FORMS,
    TIME_S,
    form_of,
    regular,
    rises,
    seconds_of,
    unit_of_times,
)
from tumblecal.recordings.columns import Column, stated_rate
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.table import Table


_CELLS, _CLOCK_ROWS = 100, 1000


def clock_among(first: pl.DataFrame, free: Sequence[str], notes: list[str]) -> Column | None:
    """The clock among unassigned columns: of those that rise, one with dates or a unit, then the one whose name has the fewest
    other words, then one with regular steps; any column with dates goes before a clock without a unit. `notes`: gets the
    next one."""
    dated = [name for name in free if first[name].dtype.is_temporal() or "<hour>" in FORMS.get(_form(first[name]), "")]
    composed = composed_clocks(first, free)
    larger = {part.name for column in composed.values() for part in column.parts[1:]}
    named = [name for name in free if role_of(name)[0] == "time" and name not in larger]
    numbers = {name: _in_seconds(first, name).numbers(first) for name in named}

    def order(name: str) -> tuple[bool, bool, int, bool]:
        steps, stated = np.diff(numbers[name][np.isfinite(numbers[name])]), parsed(name).unit or name in dated
        return not stated, name not in composed, parsed(name).foreign, not regular(steps)

    named.sort(key=order)
    usable = [name for name in named if name in dated or name in composed or rises(numbers[name])]
    notes += [f"column {name} does not rise: no clock" for name in named if name not in usable]
    found = usable if usable and not all(order(usable[0])[:2]) else [*dated, *usable]
    for other in [name for name in usable if name != found[0]][:1]:
        notes.append(f"clock: {found[0]}, not {other}; to override: --columns {shlex.quote(f'time={other}')}")
    return Column(found[0], parsed(found[0]).unit, "name" if found[0] in named else "dates") if found else None


def composed_clocks(first: pl.DataFrame, names: Sequence[str]) -> dict[str, Column]:
    """Clocks in several columns, by the column of their smallest parts: dates, hours, minutes, seconds and their fractions.

    A column of whole numbers is the larger part of another one whose readings are all less than its unit; a date is that of a
    time of day only.
    """
    parts = {name: _in_seconds(first, name) for name in names}
    parts = {name: part for name, part in parts.items() if part.unit and (part.form or role_of(name)[0] == "time")}
    values, composed = {name: part.numbers(first) for name, part in parts.items()}, dict[str, Column]()
    for name, part in sorted(parts.items(), key=lambda item: -item[1].scale):
        larger = [
            other for other in parts.values()
            if np.nanmax(values[name], initial=part.scale) < other.scale and np.nanmin(values[name], initial=0.0) >= 0
            and not (values[other.name] / other.scale % 1 > 0).any() and (part.of_day or other.scale < DAY_S)
        ]  # fmt: skip
        if larger and (part.of_day or not part.form):
            whole = min(larger, key=lambda other: other.scale)
            composed[name] = replace(part, whole=composed.get(whole.name, whole))
    return composed


def _form(cells: pl.Series) -> str:
    """The form of times in cells of text, by the first and last of them."""
    if cells.dtype != pl.String or not form_of(cells.head(_CELLS).drop_nulls().to_list()):
        return ""
    return form_of(pl.concat([cells.head(_CLOCK_ROWS), cells.tail(_CLOCK_ROWS)]).drop_nulls().to_list())


def _in_seconds(first: pl.DataFrame, name: str) -> Column:
    """A column of times in seconds, by the form or type of its cells or its name; without a unit if none of them states it."""
    cells = first[name].drop_nulls()
    if not len(cells):
        return Column(name)
    if cells.dtype.is_temporal():
        scale = DAY_S if cells.dtype == pl.Date else TIME_S[getattr(cells.dtype, "time_unit", "ns")]
        return Column(name, "s", scale=scale, offset=float(cells.to_physical()[0]))
    if form := _form(cells):
        begin = first.select(seconds_of(name, form)).to_series().drop_nulls()
        day = float(begin[0] // DAY_S) if len(begin) and "<year>" in FORMS[form] else 0.0
        return Column(name, "s", scale=1.0 if "<hour>" in FORMS[form] else DAY_S, form=form, offset=day)
    unit = parsed(name).unit
    return Column(name, "s" if unit in TIME_S else "", scale=TIME_S.get(unit, 1.0))


def clock_with_unit(
    table: Table,
    first: pl.DataFrame,
    column: Column,
    free: Sequence[str],
    options: RecordingOptions,
    path: str,
    notes: list[str],
) -> Column | None:
    """A clock with its form, unit and larger parts among `free` columns; None, with a note, for one that cannot be used.

    **Raises:** `InputError` for times that cannot be read, or whose unit is not stated.
    """
    cells, name = first[column.name].drop_nulls(), column.name
    if options.time_unit and options.time_unit not in TIME_S:
        raise InputError(f"--time-unit {options.time_unit}: not known; write one of {', '.join(TIME_S)}")
    if not len(cells):
        notes.append(f"column {name} is empty: ignored")
        return None
    own = composed_clocks(first, [name, *free]).get(name) or _in_seconds(first, name)
    if own.whole or own.form or isinstance(cells.dtype, pl.Datetime | pl.Duration | pl.Time):
        return replace(own, why=column.why)
    times = column.numbers(first)
    if not np.isfinite(times).any() or cells.dtype == pl.Date:
        words = f"column {name}: {shown(str(cells[0]))} cannot be read as a time"
        if not options.rate:
            cure = "write seconds, h:m:s.f or dates such as 2026-03-29T01:59:30.010, or give --rate 100 to omit it"
            raise InputError(f"{path}: {words}; {cure}")
        notes.append(f"{words}: ignored")
        return None
    unit, note = unit_of_times(times, name, options.time_unit or column.unit, options.rate or stated_rate(table), path)
    notes += [note] * bool(note)
    if not unit:
        return None
    return replace(column, unit="s", scale=TIME_S[unit], unit_why="the rate that it gives" if note else "file")
