"""Units of a recording's columns: by option, by name, or guessed from the size of gravity and the rate (and reported)."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from tumblecal.capture.columns.clock_text import FORMS, form_of, seconds_of
from tumblecal.capture.columns.number_range import Wrap, wraps_of_force, wraps_of_rates
from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.capture.recordings.table import SourceTable
from tumblecal.data.cells import LARGEST_NUMBER
from tumblecal.data.table import DIFFERENT_UNITS
from tumblecal.data.text_layout import ROW
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import UNITS_PER_G
from tumblecal.ground.text_file import shown


FORCE, RATE = tuple(f"a{axis}" for axis in AXES), tuple(f"g{axis}" for axis in AXES)
# Xsens counts steps of 0.1 ms (MT Manager), or of 1 us (DOT): with the wrong one, the rate is below that of any IMU.
FINE = "100us"
TIME_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, FINE: 1e-4}
# Range of sample rates of IMUs, Hz.
_SLOWEST_HZ, _FASTEST_HZ = 8.0, 20000.0
# Readings whose size is one g in some unit to within this factor have this unit.
_ALIKE = 1.3
_CLOCK_ROWS = 1000
_UNITS = {"m/s2": "ms2", "m/s^2": "ms2", "m/s²": "ms2", "ms2": "ms2", "g": "g", "mg": "mg"}
_RATE_UNITS = {"dps": "dps", "deg/s": "dps", "°/s": "dps", "rad/s": "rads", "rads": "rads"}


@dataclass(frozen=True)
class Column:
    """The column of a quantity: its `name` in the source; a reading is `scale (number - offset)` in `unit`.

    `wrap`: correction of numbers outside the range of their type, applied first. `whole`: the column of the whole seconds of
    a clock whose fractions of a second are in `name`.
    """

    name: str
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0
    wrap: Wrap | None = None
    whole: str = ""

    @property
    def names(self) -> list[str]:
        """The columns of the source that contain it."""
        return [self.name, self.whole] if self.whole else [self.name]


def reading_of(column: Column) -> pl.Expr:
    """The readings of a column, or the seconds of a clock of dates or times of day."""
    if column.unit in FORMS:
        return seconds_of(column.name, column.unit, column.offset)
    values = pl.col(column.name).cast(pl.Float64, strict=False)
    values = column.wrap.corrected(values) if column.wrap else values
    values = (values - column.offset) * column.scale
    return values + pl.col(column.whole).cast(pl.Float64, strict=False) if column.whole else values


def numbers_of(frame: pl.DataFrame, column: Column) -> np.ndarray:
    """The readings of a column, (n,); NaN for cells without a number, or with one too large for any quantity."""
    values = frame.select(reading_of(column)).to_series().to_numpy()
    return np.where(np.abs(values) < LARGEST_NUMBER, values, np.nan)


def _with_unit(named: dict[str, Column], roles: tuple[str, ...], unit: str) -> dict[str, Column]:
    return named | {role: replace(named[role], unit=unit) for role in roles if role in named}


def _stated_unit(text: str, option: str, per: str) -> tuple[str, float | None]:
    """A unit as a user writes it, and its counts for one g (or dps, by `per`)."""
    plain = text.lower().replace(" ", "")
    unit = (_UNITS if per == "g" else _RATE_UNITS).get(plain)
    counts = re.fullmatch(rf"(?:lsb|counts)?([0-9.e+]+)(?:lsb|counts?)?/{per}", plain)
    if not unit and not counts and plain not in ("counts", "lsb"):
        known = "g, mg, m/s2, or counts such as 16384/g" if per == "g" else "dps, rad/s, or counts such as 131/dps"
        raise InputError(f"{option} {text}: not a unit; write {known}")
    return unit or "counts", float(counts[1]) if counts else None


def per_g_of(text: str) -> float | None:
    """Units for one g, from a unit as a user states it; None if it is not stated.

    **Raises:** `InputError` for an unknown unit.
    """
    if not text:
        return None
    unit, counts = _stated_unit(text, "--unit", "g")
    return counts or {"g": 1.0, "mg": 1000.0, "ms2": UNITS_PER_G["m/s2"]}.get(unit)


def check_units(table: SourceTable, named: dict[str, Column], options: RecordingOptions, path: str) -> None:
    """Check that the names of the axes state one unit, unless an option gives the unit.

    **Raises:** `InputError` with the columns of different units.
    """
    for roles, unit in ((FORCE, options.unit), (RATE, options.gyro_unit)):
        stated = [named[role] for role in roles if role in named and named[role].unit]
        if not unit and len({column.unit for column in stated}) > 1:
            raise InputError(f"{table.place(path)}: {', '.join(column.name for column in stated)} {DIFFERENT_UNITS}")


def _unit_by_name(named: dict[str, Column], roles: tuple[str, ...]) -> str:
    """The unit that the names of some axes state; empty if none does."""
    return next((named[role].unit for role in roles if role in named and named[role].unit), "")


def force_unit(
    table: SourceTable, named: dict[str, Column], options: RecordingOptions, size: float
) -> tuple[dict[str, Column], float | None, list[str]]:
    """The unit of the accelerations: by option, by name, or the one in which their size is about one g."""
    if options.unit:
        unit, per_g = _stated_unit(options.unit, "--unit", "g")
        return _with_unit(named, FORCE, unit), per_g, []
    by_name = _unit_by_name(named, FORCE)
    if by_name and by_name != "counts":
        return _with_unit(named, FORCE, by_name), None, []
    if "a" in table.per_unit and not options.scale:
        return _with_unit(named, FORCE, "counts"), table.per_unit["a"], []
    stated = table.comments.get("counts_per_g")
    if stated and by_name == "counts":
        return _with_unit(named, FORCE, "counts"), float(stated), []
    near = unit_by_size(size)
    if not near or (by_name and not near.startswith("LSB")):
        return _with_unit(named, FORCE, "counts"), None, []
    guess = f"unit guessed: {near} (the readings' size is about {size:.5g}; to change it: --unit)"
    unit, per_g = _stated_unit(near, "unit", "g")
    return _with_unit(named, FORCE, unit), per_g, [guess]


def unit_by_size(size: float) -> str:
    """The unit in which a size of the accelerations is about one g; "" for none."""
    near = min(UNITS_PER_G, key=lambda unit: abs(np.log(max(size, 1e-300) / UNITS_PER_G[unit])))
    return near if 1 / _ALIKE < size / UNITS_PER_G[near] < _ALIKE else ""


def rate_unit(
    table: SourceTable, named: dict[str, Column], options: RecordingOptions
) -> tuple[dict[str, Column], list[str]]:
    """The unit of the angular rates; counts stay counts unless the counts for one deg/s are known."""
    rates = tuple(role for role in RATE if role in named)
    if not rates:
        return named, []
    unit, per_dps = (
        _stated_unit(options.gyro_unit, "--gyro-unit", "dps")
        if options.gyro_unit
        else (_unit_by_name(named, rates), None)
    )
    per_dps = per_dps or (table.per_unit.get("g") if unit == "counts" else None)
    if per_dps:
        per = {role: replace(named[role], unit="dps", scale=named[role].scale / per_dps) for role in rates}
        return named | per, []
    words = [] if unit else ["unit of the angular rates not known: not converted (to set it: --gyro-unit)"]
    # If the accelerations are counts, so are the rates.
    return _with_unit(named, rates, unit or ("counts" if named["ax"].unit == "counts" else "raw")), words


def in_range(
    table: SourceTable,
    named: dict[str, Column],
    options: RecordingOptions,
    first: pl.DataFrame,
    known: Mapping[str, Wrap],
) -> dict[str, Column]:
    """The columns with the corrections of numbers outside the range of their type: `known` ones, or from the first rows."""
    if known:
        return {role: replace(column, wrap=known.get(role)) for role, column in named.items()}
    per_g = (
        per_g_of(options.unit)
        or table.per_unit.get("a")
        or UNITS_PER_G.get(_unit_by_name(named, FORCE).replace("ms2", "m/s2"))
    )
    wraps = wraps_of(named, first, per_g)
    return {role: replace(column, wrap=wraps.get(role)) for role, column in named.items()}


def wraps_of(named: Mapping[str, Column], first: pl.DataFrame, per_g: float | None) -> dict[str, Wrap | None]:
    """Corrections of accelerations and rates outside the range of their type; `per_g`: as of `per_g_of`."""
    wraps = dict[str, Wrap | None]()
    for roles in (FORCE, tuple(role for role in RATE if role in named)):
        if not roles:
            continue
        numbers = np.stack([numbers_of(first, Column(named[role].name)) for role in roles], axis=1)
        scale = np.array([named[role].scale for role in roles])
        found = wraps_of_force(numbers, scale, per_g) if roles == FORCE else wraps_of_rates(numbers)
        wraps |= dict(zip(roles, found or [], strict=False))
    return wraps


def unit_of_step(step: float) -> str:
    """The first unit in which a time step is plausible for an IMU; empty if there is none."""
    return next((u for u, s in TIME_S.items() if step > 0 and _SLOWEST_HZ < 1 / (step * s) < _FASTEST_HZ), "")


def time_unit(
    table: SourceTable, named: dict[str, Column], options: RecordingOptions, first: pl.DataFrame, path: str
) -> tuple[dict[str, Column], list[str]]:
    """The unit of the times: by option, by name, or the first in which the rate is plausible for an IMU.

    **Raises:** `InputError` for times that cannot be read, or are not times.
    """
    column = named["time"]
    if column.whole:
        return named, []
    unit, guesses = options.time_unit or column.unit, []
    if unit and unit not in TIME_S:
        raise InputError(f"--time-unit {unit}: not known; write one of {', '.join(TIME_S)}")
    clock = _clock(first, column)
    if clock:
        return named | {"time": clock}, guesses
    if first[column.name].null_count() == len(first):
        return {role: other for role, other in named.items() if role != "time"}, [
            f"column {column.name} is empty: ignored"
        ]
    times = numbers_of(first, column)
    if not np.isfinite(times).any() or first[column.name].dtype == pl.Date:
        words = f"{unread(table, first, column)} cannot be read as a time"
        if options.rate:
            return {role: other for role, other in named.items() if role != "time"}, [
                f"{words}: ignored, --rate is used"
            ]
        raise InputError(
            f"{path}:{words}; write seconds, h:m:s.f or dates such as 2026-03-29T01:59:30.010, or give --rate 100 to go "
            "without"
        )
    steps = np.diff(times[np.isfinite(times)])
    steps = steps[steps > 0]
    # Without gaps, but including bursts.
    step = float(np.mean(steps[steps < 20 * np.median(steps)])) if len(steps) else 0.0
    if not unit or (not options.time_unit and unit == FINE and step * TIME_S[FINE] * _SLOWEST_HZ > 1):
        unit = unit_of_step(step)
        if not unit:
            raise InputError(
                f"{path}: column {column.name}: its steps of {step:g} are not sample times in s, ms, us or ns; give "
                "--time-unit, or --rate without it"
            )
        guesses.append(f"time unit guessed: {unit} ({1 / (step * TIME_S[unit]):.4g} samples a second)")
    return named | {"time": Column(column.name, "s", TIME_S[unit])}, guesses


def unread(table: SourceTable, first: pl.DataFrame, column: Column) -> str:
    """The first cell of a column that is not a number, and its place, for a fault."""
    at = _first_filled(first, column)
    if at is None:
        return f"column {column.name}: every cell is empty or NaN"
    row = f"{table.row_word} {first[ROW][at]}, " if ROW in first.columns else ""
    return f"{row}column {column.name}: {shown(first[column.name][at])}"


def first_cell(first: pl.DataFrame, column: Column) -> object:
    """The first cell of a column that is not a number, or None."""
    at = _first_filled(first, column)
    return None if at is None else first[column.name][at]


def _first_filled(first: pl.DataFrame, column: Column) -> int | None:
    cells = first[column.name]
    if cells.dtype.is_numeric():
        return None
    return next((k for k, cell in enumerate(cells) if cell is not None and str(cell).strip()), None)


def _clock(first: pl.DataFrame, column: Column) -> Column | None:
    """A column of dates or times of day, with its form as unit and the first day as offset; None for other times."""
    cells = first[column.name].drop_nulls()
    if isinstance(cells.dtype, pl.Datetime | pl.Duration | pl.Time) and len(cells):
        scale = TIME_S[getattr(cells.dtype, "time_unit", "ns")]
        return Column(column.name, "s", scale, float(cells.to_physical()[0]))
    if cells.dtype != pl.String:
        return None
    ends = pl.concat([cells.head(_CLOCK_ROWS), cells.tail(_CLOCK_ROWS)])
    form = form_of(ends.to_list()) if len(ends) else None
    if form is None:
        return None
    begin = ends.to_frame().select(seconds_of(column.name, form)).to_series().drop_nulls()
    return Column(column.name, form, 1.0, float(begin[0] // 86400) if len(begin) else 0.0)
