"""The clock of a recording in seconds: numbers in a unit, dates, times of day, or whole seconds and their fraction."""

import re
from collections.abc import Sequence

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.ground.errors import InputError


TIME_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "100us": 1e-4}
# Sample rates of inertial sensors, and of the slowest logs, Hz.
_SLOWEST_HZ, _FASTEST_HZ, _SLOWEST_LOG_HZ = 8.0, 20000.0, 0.01
_SLOW_STEPS_S = (1, 2, 3, 4, 5, 6, 10, 12, 15, 20, 30, 60, 100, 120)
# Numbers of a clock that counts from 1970, between 2001 and 2100.
_EPOCH_S = (1e9, 4.2e9)
_MOST_OTHER, _MOST_BACK = 0.2, 0.01
DAY_S, _HOUR_S, _MINUTE_S = 86400, 3600, 60
# A longer step of time, or one backwards, is a gap: no interval extends across it.
LONGEST_STEP_S = 0.5
_TIME = (
    r"(?P<hour>\d{1,3}):(?P<minute>[0-5]\d):(?P<second>[0-5]\d(?:[.,:]\d*)?)"
    r"\s*(?P<half>[AaPp])?\.?(?:[Mm]\.?)?\s*(?P<zone>Z|UTC|[+-]\d\d:?\d\d)?\s*$"
)
_DAY, _MONTH, _YEAR = r"(?P<day>\d{1,2})", r"(?P<month>\d{1,2})", r"(?P<year>\d{4}|\d\d)"
FORMS = {
    "y-m-d h:m:s": rf"^\s*(?P<year>\d{{4}})[-/.]{_MONTH}[-/.]{_DAY}[T,]?\s*{_TIME}",
    "d-Mon-y h:m:s": rf"^\s*{_DAY}-(?P<name>[A-Za-z]{{3}})-{_YEAR}\s+{_TIME}",
    "d.m.y h:m:s": rf"^\s*{_DAY}\.{_MONTH}\.{_YEAR}[T,]?\s*{_TIME}",
    "m/d/y h:m:s": rf"^\s*{_MONTH}[/-]{_DAY}[/-]{_YEAR}[T,]?\s*{_TIME}",
    "d/m/y h:m:s": rf"^\s*{_DAY}[/-]{_MONTH}[/-]{_YEAR}[T,]?\s*{_TIME}",
    # If day and month of a date are ambiguous, only the time of day is used.
    "day h:m:s": rf"^\s*\d{{1,2}}[/-]\d{{1,2}}[/-]\d{{2,4}}[T,]?\s*{_TIME}",
    "h:m:s": rf"^\s*{_TIME}",
}


def form_of(cells: Sequence[str]) -> str:
    """The form of times written as text, one of `FORMS`; empty for any other form."""
    for form, pattern in FORMS.items():
        found = [match.groupdict() for match in (re.match(pattern, cell) for cell in cells) if match]
        if not found or len(found) <= (1 - _MOST_OTHER) * len(cells):
            continue
        impossible = any(int(parts.get("month", 1)) > 12 for parts in found)
        unclear = form[1] == "/" and all(int(parts["day"]) <= 12 for parts in found)
        if not impossible and not unclear:
            return form
    return ""


def seconds_of(name: str, form: str, first_day: float = 0.0) -> pl.Expr:
    """The times of a column of text, s, from midnight of a day (counted from 1970); null for cells of another form."""
    group = pl.col(name).str.extract_groups(FORMS[form]).struct.field
    hour, minute = (group(unit).cast(pl.Int64, strict=False) for unit in ("hour", "minute"))
    second = group("second").str.replace("[,:]", ".").cast(pl.Float64, strict=False)
    half = group("half").str.to_lowercase()
    hour = pl.when(half.is_null()).then(hour).otherwise(hour % 12 + 12 * (half == "p").cast(pl.Int64))
    ahead = group("zone").str.replace(":", "", literal=True).cast(pl.Int64, strict=False).fill_null(0)
    ahead = ahead.sign() * (ahead.abs() // 100 * _HOUR_S + ahead.abs() % 100 * _MINUTE_S)
    of_day = hour * _HOUR_S + minute * _MINUTE_S - ahead + second
    if "<year>" not in FORMS[form]:
        return of_day
    year = pl.when(group("year").str.len_chars() == 2).then("20" + group("year")).otherwise(group("year"))
    month, kind = ("name", "%Y-%b-%d") if "<name>" in FORMS[form] else ("month", "%Y-%m-%d")
    date = pl.concat_str([year, group(month), group("day")], separator="-").str.to_date(kind, strict=False)
    return (date.cast(pl.Int64) - int(first_day)) * DAY_S + of_day


def rises(times: NDArray[np.float64]) -> bool:
    """Whether numbers may be times: they increase, but for a few rows."""
    steps = np.diff(times[np.isfinite(times)])
    return len(steps) > 0 and bool((steps > 0).any()) and float(np.mean(steps < 0)) <= _MOST_BACK


def unit_of_times(
    times: NDArray[np.float64], name: str, stated: str, rate_hz: float | None, path: str
) -> tuple[str, str]:
    """The unit of times, and a note if it was not stated.

    A stated rate has one possible unit, and so have dates from 1970 whose rate is possible. Otherwise it is the first unit in
    which the rate is one of a sensor, unless the steps may also be the seconds of a slow log. No unit, with a note, is for
    times that contradict a stated rate.

    **Raises:** `InputError` with the options, if more than one unit is possible, or none.
    """
    times = times[np.isfinite(times)]
    steps = np.diff(times)
    steps = steps[steps > 0]
    step = float(np.mean(steps[steps < 20 * np.median(steps)])) if len(steps) else 0.0
    if stated == "100us" and step * TIME_S[stated] * _SLOWEST_HZ > 1:
        stated = "us"  # Xsens counts steps of 0.1 ms (MT Manager) or of 1 us (DOT)
    if stated:
        return stated, ""
    usual = ("s", "ms", "us", "ns")
    rates = {unit: 1 / (step * TIME_S[unit]) for unit in usual} if step else {}
    if rate_hz and rates:
        found = [unit for unit, rate in rates.items() if 0.5 < rate / rate_hz < 2]
        if not found:
            return "", f"column {name}: no unit of its times gives {rate_hz:g} Hz: not used (to use it: --time-unit)"
    else:
        found = [unit for unit in rates if _EPOCH_S[0] < times[0] * TIME_S[unit] < _EPOCH_S[1]]
        found = [unit for unit in found if _SLOWEST_LOG_HZ < rates[unit] < _FASTEST_HZ]
    if not found:
        found = [unit for unit, rate in rates.items() if _SLOWEST_HZ < rate < _FASTEST_HZ][:1]
        if step < 1 and _SLOWEST_LOG_HZ < rates.get("s", 0.0) < _FASTEST_HZ:
            found = ["s"]
        elif any(abs(step / usual_s - 1) < 0.01 for usual_s in _SLOW_STEPS_S):
            found = ["s", *found]
    if len(found) != 1:
        shown = " or ".join(f"--time-unit {unit} ({rates[unit]:.4g} Hz)" for unit in found)
        raise InputError(
            f"{path}: column {name}: no unit of the times is stated, and its steps are {step:g}; give "
            f"{shown or '--time-unit, or --rate 100 without the times'}"
        )
    rate = rates.get(found[0], np.nan)
    return found[0], f"time unit guessed: {found[0]} ({rate:.4g} samples a second; to change it: --time-unit)"
