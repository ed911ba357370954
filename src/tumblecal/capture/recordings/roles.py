"""What the columns of a recording are, and in which units: as asked, as the format says, by their names, or by the numbers."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tumblecal.capture.protocols.text_layout import names_of, roles_of_values
from tumblecal.capture.recordings.options import Asked
from tumblecal.capture.recordings.table import ROW, SourceTable
from tumblecal.capture.recordings.time_or_temperature import EITHER, settled
from tumblecal.capture.recordings.units import (
    FORCE,
    RATE,
    TIME_S,
    Column,
    force_unit,
    numbers_of,
    rate_unit,
    time_unit,
    unread,
)
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown


if TYPE_CHECKING:
    import polars as pl

LABELS = ("position", "run", "mount")
NUMBERS = ("alpha_deg", "beta_deg", "approach")
_QUANTITIES = (*FORCE, *RATE, "time", "temperature", *LABELS, *NUMBERS)
_WORDS = {
    r"[\[(]?(m_?/?s(\^|\*\*)?2|m/s²|mps2|m_s-2)[\])]?": "ms2",
    r"[\[(]?(rad(ians)?(_?/?s(ec)?)?|rps)[\])]?": "rads",
    r"[\[(]?(dps|deg(rees)?_?/?s(ec)?|°/s)[\])]?": "dps",
    r"[\[(]?(raw|lsb|counts?|adc)[\])]?": "counts",
    r"[\[(]mg[\])]|mg": "mg",
    r"[\[(]g[\])]": "g",
}
_NAMES = {
    r"linear[ _.]?acc\w*|accelerometer|acceleration": "acc",
    r"angular[ _.]?(velocity|rate)|gyroscope|omega": "gyr",
    r"[\[(]0[\])]": "_x",
    r"[\[(]1[\])]": "_y",
    r"[\[(]2[\])]": "_z",
}
_CLOCK = re.compile(
    r"(?:time|timestamp|zeit|elapsed(?:_time)?|header_stamp|t(?=.))_?(?:[\[(]?(s|ms|us|µs|ns|secs?|seconds)[\])]?)?"
)
_CLOCK_UNITS = {"sec": "s", "secs": "s", "seconds": "s", "µs": "us"}
_CELSIUS = re.compile("°?_?c|deg_?c|celsius")
_WARMTH = re.compile(r"(?:t|tmp|temp|temperature?|temperatur)(?:_?[\[(]_?(.+?)[\])]|_(°?c|deg_?c|celsius))")


@dataclass(frozen=True)
class Layout:
    """What is taken of a table.

    **Arguments:**

    - `columns`: by quantity (`ax` .. `gz`, `time`, `temperature`, `position` ...).
    - `per_g`: counts a g, where readings are counts and that is known; `said`: what was guessed, in words.
    """

    table: SourceTable
    columns: Mapping[str, Column]
    per_g: float | None
    size: float
    said: tuple[str, ...]

    @property
    def unit(self) -> str:
        """Of the accelerations: g, mg, ms2 or counts."""
        return self.columns["ax"].unit


def has_force(table: SourceTable, asked: Asked) -> bool:
    """Whether a table has the three accelerations by name, as asked or as its format says."""
    return set(FORCE) <= set(_named(table, asked))


def layout_of(table: SourceTable, asked: Asked, path: str) -> Layout:
    """Settle what the columns are.

    **Raises:** `InputError` when the three accelerations are not among them, or for options that fit nothing.
    """
    named = _named(table, asked)
    first = next(iter(table.pieces(_numeric_first(table, named))), None)
    if first is None or not len(first):
        raise InputError(f"{path}: no rows")
    said = list[str]()
    if not set(FORCE) & set(named):
        named |= _by_values(table, first)
        said += [f"columns by their values: {', '.join(f'{role}={column.name}' for role, column in named.items())}"]
    named, words = settled(named, first, path)
    said += words
    lacking = [role for role in FORCE if role not in named]
    if lacking:
        raise InputError(
            f"{path}: {', '.join(lacking)} not found among the columns {shown(', '.join(table.columns))}; say which they "
            "are: --columns ax=...,ay=...,az=..."
        )
    unreadable = [role for role in (*FORCE, *RATE, "temperature") if role in named and _holds_none(first, named[role])]
    for role in unreadable:
        if role in (*FORCE, *_asked_for(table, asked)):
            raise InputError(f"{path}:{unread(table, first, named[role])}: no number; write numbers, or give --columns")
    # What a device does not send stands as empty columns in some formats; of a column of words it is said.
    words = [role for role in unreadable if not _numeric_or_empty(first, named[role])]
    said += [f"{unread(table, first, named[role])}: no number; left out as {role}" for role in words]
    named = _scaled({role: column for role, column in named.items() if role not in unreadable}, asked)
    force = np.stack([numbers_of(first, named[role]) for role in FORCE], axis=1)
    lengths = np.linalg.norm(force, axis=1)
    if np.isnan(lengths).all():
        there = ", ".join(named[role].name for role in FORCE)
        raise InputError(f"{path}: no row holds a number in each of {there}; another layout; give --columns")
    size = float(np.nanmedian(lengths))
    named, per_g, words = force_unit(table, named, asked, size)
    named, gyro = rate_unit(table, named, asked)
    if "time" in named:
        named, clock = time_unit(table, named, asked, first, path)
        words = [*words, *clock]
    return Layout(table, named, per_g, size, (*said, *words, *gyro))


def _named(table: SourceTable, asked: Asked) -> dict[str, Column]:
    """Columns by their quantity, by name alone; what the user says goes before what the format and the names say."""
    asked_for = _asked_for(table, asked)
    taken = {column.name for column in asked_for.values()}
    named: dict[str, Column] = {}
    for name in table.columns:
        quantity, unit = _role(table.roles.get(name) or _cleaned(name))
        if quantity and quantity not in named and name not in taken:
            named[quantity] = Column(name, unit)
    return named | asked_for


def _asked_for(table: SourceTable, asked: Asked) -> dict[str, Column]:
    """The columns that a user names.

    **Raises:** `InputError` for a quantity or a column that there is not.
    """
    asked_for = {}
    for role, column in _pairs(asked.columns, "--columns").items():
        quantity, unit = _role(role)
        if quantity not in _QUANTITIES:
            raise InputError(f"--columns {role}={column}: no such quantity; there are {', '.join(_QUANTITIES)}")
        if column not in table.columns:
            number = int(column) if column.isdecimal() else 0
            if not 1 <= number <= len(table.columns):
                there = shown(", ".join(table.columns))
                raise InputError(f"--columns {role}={column}: no such column; the recording has {there}")
            column = table.columns[number - 1]
        asked_for[quantity] = Column(column, unit)
    return asked_for


def _holds_none(first: "pl.DataFrame", column: Column) -> bool:
    return not np.isfinite(numbers_of(first, column)).any()


def _numeric_or_empty(first: "pl.DataFrame", column: Column) -> bool:
    cells = first[column.name]
    return cells.dtype.is_numeric() or not any(str(cell).strip() for cell in cells.drop_nulls())


def _cleaned(name: str) -> str:
    """A column's name as `names_of` knows it, its unit put behind."""
    text, unit = name.strip().lower(), ""
    for pattern, own in _WORDS.items():
        shorter = re.sub(rf"(?:^|[ _.])?(?<![a-z])(?:{pattern})(?![a-z])", "", text)
        if shorter != text and shorter:
            text, unit = shorter, own
            break
    for pattern, own in _NAMES.items():
        text = re.sub(pattern, own, text)
    text = re.sub(r"[ _.]+", "_", text).strip("_")
    match = re.fullmatch(r"([ag][xyz]|time|temperature)_(g|mg|ms2|dps|rads|counts|raw|s|ms|us|ns|degc)", text)
    if match:
        return text
    if text in ("sample", "samples", "n_samples", "index", ""):
        return ""
    if text in (*LABELS, *NUMBERS):
        return text
    if text == "t":
        return name.strip()
    clock = _CLOCK.fullmatch(text)
    if clock:
        return "time" + (f"_{_CLOCK_UNITS.get(clock[1], clock[1])}" if clock[1] else "")
    warmth = _WARMTH.fullmatch(text)
    if warmth:
        return "temperature_degc" if _CELSIUS.fullmatch(warmth[1] or warmth[2]) else ""
    role = names_of([text])[0]
    quantity = {"t": "temperature", "-": "", "counter": ""}.get(role, role)
    return f"{quantity}_{unit}" if quantity and unit else quantity


def _role(text: str) -> tuple[str | None, str]:
    """Quantity and unit of `ax_ms2`, `time`, `temperature_degc` ...; None for what is none."""
    if text in (*_QUANTITIES, *EITHER):
        return text, ""
    quantity, _, unit = text.rpartition("_")
    quantity = {"t": "temperature"}.get(quantity, quantity)
    units = (
        ("g", "mg", "ms2", "counts") if quantity in FORCE else
        ("dps", "rads", "counts", "raw") if quantity in RATE else
        tuple(TIME_S) if quantity == "time" else
        ("degc",) if quantity == "temperature" else ()
    )  # fmt: skip
    return (quantity, unit) if unit in units else (None, "")


def _pairs(text: str, option: str) -> dict[str, str]:
    pairs = {}
    for part in filter(None, text.split(",")):
        key, equals, value = part.partition("=")
        if not equals or not value.strip():
            raise InputError(f"{option} {text}: write pairs such as ax=AccX,ay=AccY,az=AccZ")
        pairs[key.strip()] = value.strip()
    return pairs


def _per_axis(text: str, option: str, default: float) -> dict[str, float]:
    """A number for all accelerations, or one for each quantity named."""
    try:
        if "=" not in text:
            return dict.fromkeys(FORCE, float(text) if text else default)
        return {role: float(value) for role, value in _pairs(text, option).items()}
    except ValueError:
        raise InputError(f"{option} {text}: not a number; write 0.5, or ax=0.5,ay=0.4,az=0.5") from None


def _scaled(named: dict[str, Column], asked: Asked) -> dict[str, Column]:
    scale, offset = _per_axis(asked.scale, "--scale", 1.0), _per_axis(asked.offset, "--offset", 0.0)
    unknown = [role for role in (*scale, *offset) if role not in named]
    if unknown:
        raise InputError(f"--scale, --offset: {unknown[0]} is not among the columns; there are {', '.join(named)}")
    return {
        role: Column(column.name, column.unit, scale.get(role, 1.0), offset.get(role, 0.0))
        for role, column in named.items()
    }


def _numeric_first(table: SourceTable, named: Mapping[str, Column]) -> list[str]:
    return [column.name for column in named.values()] if set(FORCE) & set(named) else list(table.columns)


def _by_values(table: SourceTable, first: "pl.DataFrame") -> dict[str, Column]:
    """The first triple of one g is the force, a triple behind it the rate; what only rises is a time."""
    columns = [name for name in table.columns if first[name].dtype.is_numeric() and name != ROW]
    values = np.stack([numbers_of(first, Column(name)) for name in columns], axis=1) if columns else np.zeros((0, 0))
    values = values[np.isfinite(values).all(1)]
    if len(values) < 8 or values.shape[1] < 3:
        return {}
    roles = roles_of_values(values, ["-"] * len(columns))
    # A last column that has a name, and not that of a temperature, is none.
    names = {"t": "" if re.search("[A-Za-z]", columns[-1]) else "temperature"}
    return {
        names.get(role, role): Column(name)
        for role, name in zip(roles, columns, strict=True)
        if names.get(role, role) in _QUANTITIES
    }
