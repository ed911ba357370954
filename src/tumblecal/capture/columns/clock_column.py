"""The clock among the columns of a recording: by name, or by value if no name is that of a time.

A column `t` or `T` is the time or the temperature. The other columns decide, then its values, then the user.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import polars as pl

from tumblecal.capture.columns.clock_text import form_of
from tumblecal.capture.columns.column_names import EITHER, ColumnName
from tumblecal.capture.columns.units import TIME_S, Column, numbers_of, unit_of_step
from tumblecal.ground.errors import InputError


_COLDEST_DEGC, _WARMEST_DEGC = -60.0, 150.0
# Share of the steps of a clock that differ from the usual step by less than half of it.
_EQUAL_SHARE, _MOST_BACK = 0.8, 0.01
_CELLS = 100


def settled(named: Mapping[str, Column], first: pl.DataFrame, path: str) -> tuple[dict[str, Column], list[str]]:
    """The columns with `t` and `T` assigned to time or temperature, and messages about them.

    **Raises:** `InputError` if neither names nor values show whether such a column is the time.
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
            return known, [f"{words}: ignored (to use it: --columns temperature={column.name})"]
        raise InputError(
            f"{path}: {words}, and its values do not show which; give --columns time={column.name} or temperature={column.name}"
        )
    return known, []


def _kind(first: pl.DataFrame, column: Column) -> str:
    """Time or temperature by the values: a time rises in nearly equal steps at a usual rate; a temperature also falls."""
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


def may_be_times(first: pl.DataFrame, name: str) -> bool:
    """Whether a column with the name of a time can be one: dates, times of day, or numbers that increase."""
    cells = first[name].drop_nulls()
    if not cells.dtype.is_numeric():
        return len(cells) > 0 and (cells.dtype != pl.String or form_of(cells.head(_CELLS).to_list()) is not None)
    steps = np.diff(numbers_of(first, Column(name)))
    steps = steps[np.isfinite(steps)]
    return len(steps) > 0 and bool(np.mean(steps < 0) <= _MOST_BACK) and bool((steps > 0).any())


def clock_by_name(first: pl.DataFrame, names: Mapping[str, ColumnName]) -> Column | None:
    """The clock among columns, or None. Of several with names of times and values that can be times, the one whose name has
    the fewest other words."""
    clocks = sorted(
        (name for name, meaning in names.items() if meaning.quantity == "time"), key=lambda k: names[k].foreign
    )
    parted = _parted(first, {name: names[name].unit for name in clocks})
    usable = [name for name in clocks if (parted is None or name not in parted.names) and may_be_times(first, name)]
    if parted and not usable:
        return parted
    return next((Column(name, names[name].unit) for name in (*usable, *clocks)), None)


def _parted(first: pl.DataFrame, clocks: Mapping[str, str]) -> Column | None:
    """A clock in two columns, or None: one has whole seconds, the other the fraction of a second in ms, us or ns, by the units
    of the columns."""
    whole, parts = list[str](), list[Column]()
    for name in clocks if len(clocks) > 1 else ():
        scale = TIME_S.get(clocks[name], 0.0)
        values = numbers_of(first, Column(name)) if first[name].dtype.is_numeric() else np.zeros(0)
        values = values[np.isfinite(values)]
        if scale == 1 and len(values) and (values == np.round(values)).all():
            whole.append(name)
        elif 0 < scale < 1 and len(values) and values.min() >= 0 and np.ptp(values) > 0 and values.max() < 1 / scale:
            parts.append(Column(name, "s", scale))
    return replace(parts[0], whole=whole[0]) if whole and parts else None


def clock_by_values(first: pl.DataFrame, names: Mapping[str, ColumnName], *, nameless: bool) -> str:
    """The first column that is a clock by its values, among columns without the name of a time; empty for none.

    It has dates or times of day, or, if its name has no known word, numbers that only rise. In a file without names these
    are any numbers except a count of rows, otherwise nearly equal steps at the rate of an IMU. Integer steps that are nearly
    all equal may be a count.
    """
    for name in filter(first.columns.__contains__, names):
        if not first[name].dtype.is_numeric():
            if may_be_times(first, name) and first[name].n_unique() > 1:
                return name
            continue
        steps = np.diff(numbers_of(first, Column(name)))
        steps = steps[np.isfinite(steps)]
        if names[name].quantity or not len(steps) or not (steps > 0).all():
            continue
        if nameless and not (steps == 1).all():
            return name
        usual = float(np.median(steps))
        counts = usual == round(usual) and np.mean(steps == usual) > _EQUAL_SHARE
        if not counts and _kind(first, Column(name)) == "time":
            return name
    return ""
