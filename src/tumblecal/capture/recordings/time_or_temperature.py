"""A column `t` or `T` is the time or the temperature: what stands beside it tells, else its values, else the user."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from tumblecal.capture.recordings.clock_text import form_of
from tumblecal.capture.recordings.units import Column, numbers_of, unit_of_step
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    import polars as pl

EITHER = ("t", "T")
CLOCKS = frozenset(("time", "temperature", *EITHER))
_COLDEST_DEGC, _WARMEST_DEGC = -60.0, 150.0
# Of the steps of a clock so many are within half of the usual one.
_EQUAL_SHARE, _MOST_BACK = 0.8, 0.01
_CELLS = 100


def settled(named: Mapping[str, Column], first: "pl.DataFrame", path: str) -> tuple[dict[str, Column], list[str]]:
    """The columns with `t` and `T` put where they belong, and what is to be said of them.

    **Raises:** `InputError` where nothing tells whether such a column is the time.
    """
    known = {role: column for role, column in named.items() if role not in EITHER}
    used = {column.name for column in known.values()}
    waiting = {role: named[role] for role in EITHER if role in named and named[role].name not in used}
    if len(waiting) == 2:
        return {"time": waiting["t"], "temperature": waiting["T"]} | known, []
    for column in waiting.values():
        if "temperature" in known:
            return {"time": column} | known, []
        kind = _kind(first, column)
        if kind:
            return {kind: column} | known, [f"column {column.name} is the {kind}, by its values"] * (kind not in known)
        words = f"column {column.name} may be the time or the temperature"
        if "time" in known:
            return known, [f"{words}: left out (--columns temperature={column.name})"]
        raise InputError(
            f"{path}: {words}, its values tell neither; give --columns time={column.name} or temperature={column.name}"
        )
    return known, []


def _kind(first: "pl.DataFrame", column: Column) -> str:
    """By the values: what rises in nearly equal steps, of a usual rate, is the time; what falls too, or never, is none."""
    if not first[column.name].dtype.is_numeric():
        return "time"
    values = numbers_of(first, column)
    values = values[np.isfinite(values)]
    if len(values) < 3:
        return ""
    steps = np.diff(values)
    step = float(np.median(steps))
    equal = np.mean(np.abs(steps - step) <= 0.5 * abs(step)) >= _EQUAL_SHARE
    if step > 0 and equal and np.mean(steps < 0) <= _MOST_BACK and unit_of_step(step):
        return "time"
    rises = (steps >= 0).all() and steps.any()
    usual = values.min() > _COLDEST_DEGC and values.max() < _WARMEST_DEGC
    return "temperature" if usual and not rises else ""


def may_be_times(first: "pl.DataFrame", name: str) -> bool:
    """Whether a column that is named a time can be one: moments, times of day, or numbers that go on."""
    import polars as pl

    cells = first[name].drop_nulls()
    if not cells.dtype.is_numeric():
        return len(cells) > 0 and (cells.dtype != pl.String or form_of(cells.head(_CELLS).to_list()) is not None)
    steps = np.diff(numbers_of(first, Column(name)))
    steps = steps[np.isfinite(steps)]
    return len(steps) > 0 and bool(np.mean(steps < 0) <= _MOST_BACK) and bool((steps > 0).any())


def rising(first: "pl.DataFrame", names: Sequence[str]) -> str:
    """The first column that only rises and is no count of rows; empty for none."""
    for name in filter(first.columns.__contains__, names):
        if first[name].dtype.is_numeric():
            steps = np.diff(numbers_of(first, Column(name)))
            steps = steps[np.isfinite(steps)]
            if len(steps) and (steps > 0).all() and not (steps == 1).all():
                return name
    return ""
