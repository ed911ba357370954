"""The column of the clock of a recording, by its name or its dates, with its form and unit."""

import shlex
from collections.abc import Mapping, Sequence
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
    overflows,
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
    """The clock among unassigned columns: one with dates or a unit, then the one whose name has the fewest other words, then
    one with regular steps; then any column with dates. `notes`: gets the next one."""
    forms = {name: form_of(_texts(first[name].head(_CELLS))) for name in free}
    dated = [name for name in free if forms[name] or first[name].dtype.is_temporal()]
    named = [name for name in free if role_of(name)[0] == "time"]
    numbers = {name: Column(name, form=forms[name]).numbers(first) for name in named}

    def order(name: str) -> tuple[bool, int, bool]:
        steps = np.diff(numbers[name][np.isfinite(numbers[name])])
        return not (parsed(name).unit or name in dated), parsed(name).foreign, not regular(steps)

    named.sort(key=order)
    usable = [name for name in named if name in dated or (rises(numbers[name]) and not overflows(numbers[name]))]
    # Whole seconds in one column, and their fraction in ms, us or ns in another.
    scales = {name: TIME_S.get(parsed(name).unit, 0.0) for name in named if np.isfinite(numbers[name]).any()}
    whole = [name for name, scale in scales.items() if scale == 1 and not (numbers[name] % 1 > 0).any()]
    parts = [
        name for name, scale in scales.items()
        if 0 < scale < 1 and 0 <= np.nanmin(numbers[name]) < np.nanmax(numbers[name]) < 1 / scale
    ]  # fmt: skip
    if whole and parts and {*usable} <= {whole[0], parts[0]}:
        return Column(parts[0], "s", "name", scale=scales[parts[0]], whole=whole[0])
    for other in usable[1:2]:
        notes.append(f"clock: {usable[0]}, not {other}; to override: --columns {shlex.quote(f'time={other}')}")
    found = usable or named or dated
    return Column(found[0], parsed(found[0]).unit, "name" if found[0] in named else "dates") if found else None


def letters_t(
    first: pl.DataFrame, columns: Mapping[str, Column], free: Sequence[str], notes: list[str]
) -> dict[str, Column]:
    """The quantities of columns t and T: t is the time if it rises; others are the temperature if they do not rise, or the
    time next to a temperature."""
    found: dict[str, Column] = {}
    letters = [name for name in free if parsed(name).stem == ("t",) and not parsed(name).axis and not role_of(name)[0]]
    for name in sorted(letters, reverse=True):  # t before T
        known, rising = {*columns, *found}, rises(Column(name).numbers(first))
        role = "time" if rising and (name.strip()[0] == "t" or "temperature" in known) else "temperature"
        if role in known or (role == "temperature" and rising):
            notes.append(
                f"column {name} is not used (to use it: --columns time={name} or --columns temperature={name})"
            )
        else:
            found[role] = Column(name, "", "name")
    return found


def _texts(cells: pl.Series) -> list[str]:
    return cells.drop_nulls().to_list() if cells.dtype == pl.String else []


def clock_with_unit(
    table: Table, first: pl.DataFrame, column: Column, options: RecordingOptions, path: str, notes: list[str]
) -> Column | None:
    """A clock with its form and unit; None, with a note, for one that cannot be used.

    **Raises:** `InputError` for times that cannot be read, or whose unit is not stated.
    """
    cells, name = first[column.name].drop_nulls(), column.name
    if options.time_unit and options.time_unit not in TIME_S:
        raise InputError(f"--time-unit {options.time_unit}: not known; write one of s, ms, us, ns")
    if column.whole or not len(cells):
        notes += [] if column.whole else [f"column {name} is empty: ignored"]
        return column if column.whole else None
    if isinstance(cells.dtype, pl.Datetime | pl.Duration | pl.Time):
        scale = TIME_S[getattr(cells.dtype, "time_unit", "ns")]
        return replace(column, unit="s", scale=scale, offset=float(cells.to_physical()[0]))
    if form := form_of(_texts(pl.concat([cells.head(_CLOCK_ROWS), cells.tail(_CLOCK_ROWS)]))):
        begin = first.select(seconds_of(name, form)).to_series().drop_nulls()
        day = float(begin[0] // DAY_S) if len(begin) and "<year>" in FORMS[form] else 0.0
        return replace(column, unit="s", form=form, offset=day)
    times = column.numbers(first)
    counter = overflows(times)
    if counter or not np.isfinite(times).any() or cells.dtype == pl.Date:
        words = (
            f"column {name}: {'a counter that overflows' if counter else shown(str(cells[0]))} cannot be read as a time"
        )
        if not options.rate and not (counter and column.why == "name"):
            cure = "write seconds, h:m:s.f or dates such as 2026-03-29T01:59:30.010, or give --rate 100 to omit it"
            raise InputError(f"{path}: {words}; {cure}")
        notes.append(f"{words}: ignored")
        return None
    unit, note = unit_of_times(times, name, options.time_unit or column.unit, options.rate or stated_rate(table), path)
    notes += [note] * bool(note)
    if not unit:
        return None
    return replace(column, unit="s", scale=TIME_S[unit], unit_why="the rate that it gives" if note else "file")
