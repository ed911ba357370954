"""The clock of a recording in seconds: numbers in a unit, dates, times of day, or whole seconds and their fraction."""

import re
import shlex
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.data.column_names import parsed, role_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown
from tumblecal.recordings.columns import DAY_S, FORMS, TIME_S, Column, seconds_of, stated_rate
from tumblecal.recordings.guesses import question
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.table import Table


# Sample rates of inertial sensors, and of the slowest logs, Hz.
_SLOWEST_HZ, _FASTEST_HZ, _SLOWEST_LOG_HZ = 8.0, 20000.0, 0.01
# Numbers of a clock that counts from 1970, between 2001 and 2100.
_EPOCH_S = (1e9, 4.2e9)
_MOST_OTHER, _MOST_BACK = 0.2, 0.01
# Share of the steps of a regular clock that are within a quarter of the usual one.
_REGULAR = 0.8
# A longer step of time, or one backwards, is a gap: no interval extends across it.
LONGEST_STEP_S = 0.5
# Rows at the beginning and the end that show the form of times.
_CLOCK_ROWS = 1000


def rises(times: NDArray[np.float64]) -> bool:
    """Whether numbers may be times: they increase, but for a few rows."""
    steps = np.diff(times[np.isfinite(times)])
    return bool((steps > 0).any()) and float(np.mean(steps < 0)) <= _MOST_BACK


def regular(steps: NDArray[np.float64]) -> bool:
    """Whether the steps of a clock are equal, but for some of them."""
    usual = np.median(steps) if len(steps) else 0.0
    return bool(usual > 0 and np.mean(np.abs(steps - usual) < usual / 4) > _REGULAR)


def clock_among(first: pl.DataFrame, free: Sequence[str], notes: list[str]) -> Column | None:
    """The clock among unassigned columns: of those that rise, one with dates or a unit, then the one whose name has the fewest
    other words, then one with regular steps; any column with dates goes before a clock without a unit. `notes`: gets the
    next one."""
    dated = [name for name in free if first[name].dtype.is_temporal() or "<hour>" in FORMS.get(_form(first[name]), "")]
    composed = _composed(first, free)
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


def _composed(first: pl.DataFrame, names: Sequence[str]) -> dict[str, Column]:
    """Clocks in several columns, by the column of their smallest parts: dates, hours, minutes, seconds and their fractions.

    A column of whole numbers is the larger part of another one whose readings are all less than its unit; a date is that of a
    time of day only.
    """
    parts = {name: _in_seconds(first, name) for name in names}
    parts = {name: part for name, part in parts.items() if part.unit and (part.form or role_of(name)[0] == "time")}
    values, composed = {name: part.numbers(first) for name, part in parts.items()}, dict[str, Column]()
    for name, part in sorted(parts.items(), key=lambda item: -item[1].scale):
        highest, lowest = np.nanmax(values[name], initial=part.scale), np.nanmin(values[name], initial=0.0)
        larger = [
            other for other in parts.values()
            if highest < other.scale and lowest >= 0 and (part.of_day or other.scale < DAY_S)
            and not (values[other.name] / other.scale % 1 > 0).any()
        ]  # fmt: skip
        if larger and (part.of_day or not part.form):
            whole = min(larger, key=lambda other: other.scale)
            composed[name] = replace(part, whole=composed.get(whole.name, whole))
    return composed


def _form(cells: pl.Series) -> str:
    """The form of times in cells of text, one of `FORMS`, by the first and last of them; empty for any other form."""
    if cells.dtype != pl.String:
        return ""
    texts = pl.concat([cells.head(_CLOCK_ROWS), cells.tail(_CLOCK_ROWS)]).drop_nulls().to_list()
    for form, pattern in FORMS.items() if texts and re.search(r"\d\D+\d", texts[0]) else ():
        found = [match.groupdict() for cell in texts if (match := re.match(pattern, cell))]
        unclear = form[1] == "/" and all(int(parts["day"]) <= 12 for parts in found)
        possible = all(int(parts.get("month", 1)) <= 12 for parts in found)
        if len(found) > (1 - _MOST_OTHER) * len(texts) and possible and not unclear:
            return form
    return ""


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
    seconds = _composed(first, [name, *free]).get(name) or _in_seconds(first, name)
    if seconds.whole or seconds.form or isinstance(cells.dtype, pl.Datetime | pl.Duration | pl.Time):
        return replace(seconds, why=column.why)
    times = column.numbers(first)
    if not np.isfinite(times).any() or cells.dtype == pl.Date:
        words = f"column {name}: {shown(str(cells[0]))} cannot be read as a time"
        if not options.rate:
            cure = "write seconds, h:m:s.f or dates such as 2026-03-29T01:59:30.010, or give --rate 100 to omit it"
            raise InputError(f"{path}: {words}; {cure}")
        notes.append(f"{words}: ignored")
        return None
    unit, evidence = options.time_unit or column.unit, "file"
    if not unit:
        unit, note = unit_of_times(times, name, options.rate or stated_rate(table), path)
        evidence = "the rate that it gives"
        notes.append(note)
    return replace(column, unit="s", scale=TIME_S[unit], unit_why=evidence) if unit else None


def unit_of_times(times: NDArray[np.float64], name: str, rate_hz: float | None, path: str) -> tuple[str, str]:
    """The unit of times that gives a stated rate, or dates from 1970; otherwise seconds, if these give the rate of a sensor;
    and a note. No unit is for times that contradict a stated rate.

    **Raises:** `InputError` with the options for any other times.
    """
    times = times[np.isfinite(times)]
    steps = np.diff(times)
    usual = np.median(steps[steps > 0]) if (steps > 0).any() else 0.0
    step = float(np.mean(steps[(steps >= 0) & (steps < 20 * usual)])) if usual else 0.0
    rates = {unit: 1 / (step * TIME_S[unit]) for unit in ("s", "ms", "100us", "us", "ns")} if step else {}
    possible = [unit for unit, rate in rates.items() if _SLOWEST_LOG_HZ < rate < _FASTEST_HZ]
    if rate_hz and rates:
        found = [unit for unit, rate in rates.items() if 0.5 < rate / rate_hz < 2]
        if not found:
            return "", f"column {name}: no unit of its times gives {rate_hz:g} Hz: not used (to use it: --time-unit)"
    else:
        found = [unit for unit in possible if _EPOCH_S[0] < times[0] * TIME_S[unit] < _EPOCH_S[1]]
        if not found and "s" in possible and rates["s"] > _SLOWEST_HZ and usual <= LONGEST_STEP_S:
            found = ["s"]
    if not found:
        options = [f"--time-unit {unit} ({rates[unit]:.4g} Hz)" for unit in possible]
        words = f"column {name}: no unit of the times is stated, and its steps are {step:g}; give"
        raise question(path, words, options or ["--time-unit", "--rate 100 without the times"])
    rate = rates[found[0]]
    return found[0], f"time unit guessed: {found[0]} ({rate:.4g} samples a second; to change it: --time-unit)"
