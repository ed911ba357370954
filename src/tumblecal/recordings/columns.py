"""The columns of a recording with their quantities and units, as options and formats state them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.data.cells import LARGEST_NUMBER
from tumblecal.data.column_names import FORCE, QUANTITIES, RATE, exact_role, role_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.option_texts import pairs
from tumblecal.ground.text_file import shown
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.table import Table


# Keys of statements of the sample rate.
RATE_KEYS = (
    *("rate_hz", "fs", "fs_hz", "sample_rate", "sampling_rate", "sampling_rate_hz", "sampling_frequency"),
    *("update_rate", "output_rate", "measurement_frequency"),
)
# The option that names the columns of the accelerations, for messages.
COLUMNS_OPTION = "--columns ax=...,ay=...,az=..."
TIME_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "100us": 1e-4, "min": 60.0, "h": 3600.0}
DAY_S = 86400
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
_KINDS = dict.fromkeys(FORCE, "acceleration") | dict.fromkeys(RATE, "rate")


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


@dataclass(frozen=True)
class Column:
    """The column of a quantity: a reading is `scale (number - offset)` in `unit`.

    **Arguments:**

    - `name`: in the source. `why`: the evidence for it. `unit_why`: that for its unit; empty before units are known.
    - `form`: of times written as text; `offset` is then the first day.
    - `whole`: the column of the dates, hours, minutes or whole seconds of a clock whose parts of them are in `name`.
    - `bits`: of numbers of which negative ones are written as unsigned ones; 0 for others.
    """

    name: str
    unit: str = ""
    why: str = ""
    unit_why: str = ""
    scale: float = 1.0
    offset: float = 0.0
    form: str = ""
    whole: "Column | None" = None
    bits: int = 0

    @property
    def evidence(self) -> str:
        """The evidence for the column and its unit, in words."""
        return "; unit: ".join(filter(None, (self.why, self.unit_why)))

    @property
    def parts(self) -> tuple["Column", ...]:
        """The column, and those of the larger parts of a clock."""
        return (self, *(self.whole.parts if self.whole else ()))

    @property
    def of_day(self) -> bool:
        """Whether it is a clock that states the time of day only."""
        largest = self.parts[-1]
        return "<year>" not in FORMS[largest.form] if largest.form else largest.scale == TIME_S["h"]

    def reading(self) -> pl.Expr:
        """The readings, or the seconds of a clock; null for a cell that is no number."""
        if self.form:
            values = seconds_of(self.name, self.form, self.offset)
        else:
            values = pl.col(self.name).cast(pl.Float64, strict=False)
            if self.bits:
                values = values - 2.0**self.bits * (values >= 2.0 ** (self.bits - 1))
            values = (values - self.offset) * self.scale
        return values + self.whole.reading() if self.whole else values

    def numbers(self, frame: pl.DataFrame) -> NDArray[np.float64]:
        """The readings of some rows, (n,); NaN for cells that are no number, or too large for any quantity."""
        values = frame.select(self.reading()).to_series().to_numpy()
        return np.where(np.abs(values) < LARGEST_NUMBER, values, np.nan)


@dataclass(frozen=True)
class Layout:
    """The columns of a table by quantity.

    **Arguments:**

    - `per_g`: counts for one g, if readings are counts and it is known. `size`: of gravity in the readings.
    - `notes`: what was assumed, with the options that override it.
    """

    columns: Mapping[str, Column]
    per_g: float | None
    size: float
    notes: tuple[str, ...]

    @property
    def unit(self) -> str:
        """Unit of the accelerations: g, mg, ms2 or counts."""
        return self.columns["ax"].unit


def given_columns(table: Table, options: RecordingOptions) -> dict[str, Column]:
    """Columns by quantity, of the option `--columns` first, then of the format.

    **Raises:** `InputError` for an unknown quantity, or a column that does not exist.
    """
    columns: dict[str, Column] = {}
    names = table.columns
    for role, given in pairs("--columns", options.columns, "ax=AccX,ay=AccY,az=AccZ").items():
        quantity, unit = exact_role(role) or ("", "")
        by_number = given.isdecimal() and given not in names and 1 <= int(given) <= len(names)
        name = names[int(given) - 1] if by_number else given
        if not quantity or name not in names or quantity in columns or name in {one.name for one in columns.values()}:
            raise InputError(
                f"--columns {role}={given}: give each quantity one column, and no column twice. Quantities: "
                f"{', '.join(QUANTITIES)}; columns of the recording: {shown(', '.join(names))}"
            )
        named, named_unit = exact_role(table.roles.get(name, "")) or role_of(name)
        same = _KINDS.get(named, named) == _KINDS.get(quantity, quantity)
        columns[quantity] = Column(name, unit or (named_unit if same else ""), "option")
    used = {column.name for column in columns.values()}
    for name, text in table.roles.items():
        role, unit = exact_role(text) or ("", "")
        if role and name in names and name not in used:
            columns.setdefault(role, Column(name, unit, "format"))
    return columns


def stated_rate(table: Table) -> float | None:
    """The sample rate that the source states, Hz."""
    stated = [table.stated[key].lower().removesuffix("hz") for key in RATE_KEYS if key in table.stated]
    return next((float(text) for text in stated if is_number(text)), None)


def is_number(text: str) -> bool:
    """Whether a text is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True
