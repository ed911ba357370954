"""The column of the clock of a recording, by its name or its dates, with its form and unit."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import polars as pl

from tumblecal.data.column_names import parsed, role_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown
from tumblecal.recordings.clock import FORMS, TIME_S, form_of, overflows, rises, seconds_of, unit_of_times
from tumblecal.recordings.columns import Column, stated_rate
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.table import Table


_CELLS, _CLOCK_ROWS, _EQUAL_STEPS, _DEGC = 100, 1000, 0.8, (-60.0, 150.0)


def clock_among(first: pl.DataFrame, free: Sequence[str]) -> Column | None:
    """The clock among unassigned columns: one with dates or a unit, then the one whose name has the fewest other words."""
    numbers = {name: Column(name).numbers(first) for name in free if role_of(name)[0] == "time"}
    named = sorted(numbers, key=lambda name: parsed(name).foreign)
    usable = [
        name for name in named
        if _form(first, name) or first[name].dtype.is_temporal() or (rises(numbers[name]) and not overflows(numbers[name]))
    ]  # fmt: skip
    usable.sort(key=lambda name: not (parsed(name).unit or _form(first, name)))
    # Whole seconds in one column, and their fraction in ms, us or ns in another.
    scales = {name: TIME_S.get(parsed(name).unit, 0.0) for name in named}
    whole = [name for name in named if scales[name] == 1 and not (numbers[name] % 1).any()]
    parts = [
        name for name in named
        if 0 < scales[name] < 1 and 0 <= np.nanmin(numbers[name]) < np.nanmax(numbers[name]) < 1 / scales[name]
    ]  # fmt: skip
    if whole and parts and {*usable} <= {whole[0], parts[0]}:
        return Column(parts[0], "s", "name", scales[parts[0]], whole=whole[0])
    if usable or named:
        name = (usable or named)[0]
        return Column(name, parsed(name).unit, "name")
    return next((Column(name, "", "dates") for name in free if _form(first, name)), None)


def is_letter_t(name: str) -> bool:
    """Whether a name is a `t` alone, also with the unit degree: the time or the temperature."""
    meaning = parsed(name)
    return meaning.stem == ("t",) and not meaning.axis and meaning.quantity in ("", "orientation")


def letters_t(first: pl.DataFrame, columns: Mapping[str, Column], free: Sequence[str], notes: list[str]) -> dict[str, Column]:
    """The quantities of columns t: the time if they rise, in nearly equal steps or next to a temperature, otherwise the
    temperature."""
    found: dict[str, Column] = {}
    for name in sorted(filter(is_letter_t, free), reverse=True):  # t before T
        values = Column(name).numbers(first)
        steps = np.diff(values[np.isfinite(values)])
        known = {*columns, *found}
        equal = len(steps) > 2 and np.mean(np.abs(steps - np.median(steps)) <= 0.5 * np.median(steps)) >= _EQUAL_STEPS
        is_time = _form(first, name) or (rises(values) and (equal or "temperature" in known))
        possible = is_time or (len(steps) and not rises(values) and (np.abs(values - np.mean(_DEGC)) < 105).all())
        role = "time" if is_time else "temperature"
        if possible and role not in known:
            found[role] = Column(name, "", "values")
            notes.append(f"column {name} is the {role}, by its values; to override: --columns {role}=...")
        else:
            words = f"column {name} may be the time or the temperature"
            notes.append(f"{words}: not used (to use it: --columns time={name} or --columns temperature={name})")
    return found


def _form(first: pl.DataFrame, name: str) -> str:
    """The form of the first cells of a column of text; empty for other columns."""
    return form_of(first[name].drop_nulls().head(_CELLS).to_list()) if first[name].dtype == pl.String else ""


def with_unit(
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
    ends = pl.concat([cells.head(_CLOCK_ROWS), cells.tail(_CLOCK_ROWS)])
    if form := form_of(ends.to_list() if ends.dtype == pl.String else ()):
        begin = first.select(seconds_of(name, form)).to_series().drop_nulls()
        day = float(begin[0] // 86400) if len(begin) and "<year>" in FORMS[form] else 0.0
        return replace(column, unit="s", form=form, offset=day)
    times = column.numbers(first)
    counter = overflows(times)
    if counter or not np.isfinite(times).any() or cells.dtype == pl.Date:
        words = f"column {name}: {'a counter that overflows' if counter else shown(str(cells[0]))} cannot be read as a time"
        if not options.rate and not (counter and column.why == "name"):
            cure = "write seconds, h:m:s.f or dates such as 2026-03-29T01:59:30.010, or give --rate 100 to omit it"
            raise InputError(f"{path}: {words}; {cure}")
        notes.append(f"{words}: ignored")
        return None
    given = options.time_unit or column.unit
    unit, note = unit_of_times(times, name, given, options.rate or stated_rate(table), path)
    notes += [note] * bool(note)
    why = f"{column.why}; unit: {'the rate that it gives' if note else 'file'}"
    return replace(column, unit="s", scale=TIME_S[unit], why=why) if unit else None
