"""The clock of a recording in seconds: numbers in a unit, dates, times of day, or whole seconds and their fraction."""

import re
from collections.abc import Sequence

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.recordings.guesses import question


TIME_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "100us": 1e-4, "min": 60.0, "h": 3600.0}
# Sample rates of inertial sensors, and of the slowest logs, Hz.
_SLOWEST_HZ, _FASTEST_HZ, _SLOWEST_LOG_HZ = 8.0, 20000.0, 0.01
# Numbers of a clock that counts from 1970, between 2001 and 2100.
_EPOCH_S = (1e9, 4.2e9)
_MOST_OTHER, _MOST_BACK = 0.2, 0.01
# Share of the steps of a regular clock that are within a quarter of the usual one.
_REGULAR = 0.8
DAY_S = 86400
# A longer step of time, or one backwards, is a gap: no interval extends across it.
LONGEST_STEP_S = 0.5
_TIME = (
    r"(?P<hour>\d{1,3}):(?P<minute>[0-5]?\d):(?P<second>[0-5]?\d(?:[.,:]\d*)?)"
    r"\s*(?P<half>[AaPp])?\.?(?:[Mm]\.?)?\s*(?P<zone>Z|UTC|[+-]\d\d:?\d\d)?\s*$"
)
_DAY, _MONTH, _YEAR = r"(?P<day>\d{1,2})", r"(?P<month>\d{1,2})", r"(?P<year>\d{4}|\d\d)"
_DATES = {
    "y-m-d": rf"^\s*(?P<year>\d{{4}})[-/.]{_MONTH}[-/.]{_DAY}",
    "d-Mon-y": rf"^\s*{_DAY}-(?P<name>[A-Za-z]{{3}})-{_YEAR}",
    "d.m.y": rf"^\s*{_DAY}\.{_MONTH}\.{_YEAR}",
    "m/d/y": rf"^\s*{_MONTH}[/-]{_DAY}[/-]{_YEAR}",
    "d/m/y": rf"^\s*{_DAY}[/-]{_MONTH}[/-]{_YEAR}",
}
FORMS = {
    **{f"{form} h:m:s": rf"{date}[T,]?\s*{_TIME}" for form, date in _DATES.items()},
    # If day and month of a date are ambiguous, only the time of day is used.
    "day h:m:s": rf"^\s*\d{{1,2}}[/-]\d{{1,2}}[/-]\d{{2,4}}[T,]?\s*{_TIME}",
    "h:m:s": rf"^\s*{_TIME}",
    **{form: rf"{date}\s*$" for form, date in _DATES.items()},
}


def form_of(cells: Sequence[str]) -> str:
    """The form of times written as text, one of `FORMS`; empty for any other form."""
    for form, pattern in FORMS.items():
        found = [match.groupdict() for cell in cells if (match := re.match(pattern, cell))]
        unclear = form[1] == "/" and all(int(parts["day"]) <= 12 for parts in found)
        possible = all(int(parts.get("month", 1)) <= 12 for parts in found)
        if len(found) > (1 - _MOST_OTHER) * len(cells) and possible and not unclear:
            return form
    return ""


def seconds_of(name: str, form: str, first_day: float = 0.0) -> pl.Expr:
    """The times of a column of text, s, from midnight of a day (counted from 1970); null for cells of another form."""
    group = pl.col(name).str.extract_groups(FORMS[form]).struct.field
    seconds = pl.lit(0.0)
    if "<hour>" in FORMS[form]:
        hour, minute = (group(unit).cast(pl.Int64, strict=False) for unit in ("hour", "minute"))
        second = group("second").str.replace("[,:]", ".").cast(pl.Float64, strict=False)
        half = group("half").str.to_lowercase()
        hour = pl.when(half.is_null()).then(hour).otherwise(hour % 12 + 12 * (half == "p").cast(pl.Int64))
        # +0530 is 330 minutes ahead.
        zone = group("zone").str.replace(":", "", literal=True).cast(pl.Int64, strict=False).fill_null(0)
        minute = minute - zone + 40 * (zone / 100).cast(pl.Int64)
        seconds = hour * 3600 + minute * 60 + second
    if "<year>" not in FORMS[form]:
        return seconds
    year = ("20" + group("year")).str.slice(-4)
    month, kind = ("name", "%Y-%b-%d") if "<name>" in FORMS[form] else ("month", "%Y-%m-%d")
    date = pl.concat_str([year, group(month), group("day")], separator="-").str.to_date(kind, strict=False)
    return (date.cast(pl.Int64) - int(first_day)) * DAY_S + seconds


def rises(times: NDArray[np.float64]) -> bool:
    """Whether numbers may be times: they increase, but for a few rows."""
    steps = np.diff(times[np.isfinite(times)])
    return bool((steps > 0).any()) and float(np.mean(steps < 0)) <= _MOST_BACK


def regular(steps: NDArray[np.float64]) -> bool:
    """Whether the steps of a clock are equal, but for some of them."""
    usual = np.median(steps) if len(steps) else 0.0
    return bool(usual > 0 and np.mean(np.abs(steps - usual) < usual / 4) > _REGULAR)


def unit_of_times(
    times: NDArray[np.float64], name: str, stated: str, rate_hz: float | None, path: str
) -> tuple[str, str]:
    """The unit of times, and a note if it was not stated.

    Without a stated unit, it is the one that gives a stated rate, or dates from 1970; otherwise seconds, if these give the
    rate of a sensor. No unit, with a note, is for times that contradict a stated rate.

    **Raises:** `InputError` with the options for any other times.
    """
    times = times[np.isfinite(times)]
    steps = np.diff(times)
    usual = np.median(steps[steps > 0]) if (steps > 0).any() else 0.0
    step = float(np.mean(steps[(steps >= 0) & (steps < 20 * usual)])) if usual else 0.0
    rates = {unit: 1 / (step * TIME_S[unit]) for unit in ("s", "ms", "100us", "us", "ns")} if step else {}
    if stated:
        return stated, ""
    possible = [unit for unit, rate in rates.items() if _SLOWEST_LOG_HZ < rate < _FASTEST_HZ]
    if rate_hz and rates:
        found = [unit for unit, rate in rates.items() if 0.5 < rate / rate_hz < 2]
        if not found:
            return "", f"column {name}: no unit of its times gives {rate_hz:g} Hz: not used (to use it: --time-unit)"
    else:
        found = [unit for unit in possible if _EPOCH_S[0] < times[0] * TIME_S[unit] < _EPOCH_S[1]]
        found = found or [
            unit for unit in possible if unit == "s" and rates[unit] > _SLOWEST_HZ and usual <= LONGEST_STEP_S
        ]
    if not found:
        options = [f"--time-unit {unit} ({rates[unit]:.4g} Hz)" for unit in possible]
        words = f"column {name}: no unit of the times is stated, and its steps are {step:g}; give"
        raise question(path, words, options or ["--time-unit", "--rate 100 without the times"])
    rate = rates[found[0]]
    return found[0], f"time unit guessed: {found[0]} ({rate:.4g} samples a second; to change it: --time-unit)"
