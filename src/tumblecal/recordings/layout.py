"""The quantities of the columns of a recording, from its first rows: by option, by format, then by name.

Values check a choice by names, and order the proposals of a question.
"""

import re
import shlex
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.data.cells import advice
from tumblecal.data.column_names import FORCE, NUMBERS, RATE, STATES, Name, parsed, role_of
from tumblecal.data.text_layout import ROW
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown
from tumblecal.recordings.clock import clock_among, clock_with_unit, rises
from tumblecal.recordings.columns import COLUMNS_OPTION, Column, Layout, given_columns
from tumblecal.recordings.guesses import question
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.table import Table
from tumblecal.recordings.units import PER_G, may_be_gravity, scaled, signed_words, size_of, with_units


# Lengths that change less are computed (a unit vector); sizes below this share of gravity have none.
_LEAST_NOISE, _LEAST_GRAVITY = 1e-4, 0.25
_AXES = ("xyz", "012", "123")
_MOST_SHOWN, _MOST_COLUMNS, _MOST_DISPERSION = 4, 40, 0.05
_WITHOUT = (
    "accelerations along axes of the Earth, or without the size of gravity: no calibration is possible from them. Record the "
    "sensor's readings, or use these all the same"
)

Readings = Callable[[Sequence[str]], NDArray[np.float64]]


def layout_of(
    table: Table,
    first: pl.DataFrame,
    options: RecordingOptions,
    path: str,
    notes: list[str],
    only: Collection[str] | None = None,
) -> Layout:
    """The quantities and units of the columns of a table.

    **Arguments:**

    - `first`: the first rows. `notes`: gets what is assumed, also before an error that may follow from it.
    - `only`: the quantities that are needed, if no option names others.

    **Raises:** `InputError` if the accelerations, a unit or the clock are not stated, with an option that can be pasted.
    """

    def readings(names: Sequence[str]) -> np.ndarray:
        numbers = [Column(name, bits=options.signed or 0).numbers(first) for name in names]
        return np.reshape(numbers, (len(names), len(first))).T

    columns = given_columns(table, options)

    def free() -> list[str]:
        used = {column.name for column in columns.values()} | {ROW}
        return [name for name in table.columns if name not in used]

    if not {*FORCE} & {*columns}:
        columns |= _chosen(table.columns, free(), readings, notes, path)
    # Temperature, labels, angles and single axes: of several, the name with the fewest other words.
    unassigned = sorted(free(), key=lambda name: parsed(name).foreign)
    with_rates = {*RATE} & {*columns}
    for name in unassigned:
        role, unit = role_of(name)
        # Rates of another sensor are not used.
        if role not in ("", "time") and not (role in RATE and (parsed(name).quantity != "rate" or with_rates)):
            columns.setdefault(role, Column(name, unit, "name"))
    if "time" not in columns and (clock := clock_among(first, free(), notes)):
        columns["time"] = clock
    letters = [name for name in free() if parsed(name).stem == ("t",) and not rises(readings([name])[:, 0])]
    if "time" in columns and letters:
        columns.setdefault("temperature", Column(letters[0], "", "name"))
    if lacking := [role for role in FORCE if role not in columns]:
        words = f"{', '.join(lacking)} not found among the columns {shown(', '.join(table.columns))}; name them"
        raise question(path, words, [COLUMNS_OPTION])
    if only is not None:
        columns = {role: column for role, column in columns.items() if role in only or column.why == "option"}
    columns = scaled(_readable(table, first, columns, path, notes), options)
    values = np.stack([columns[role].numbers(first) for role in FORCE], axis=1)
    names = [columns[role].name for role in FORCE]
    sizes = size_of(values)
    if not np.isfinite(sizes[0]):
        raise question(path, f"no row has a number in each of {', '.join(names)}; give others", [COLUMNS_OPTION])
    if not options.signed and (words := signed_words(names, values)):
        raise InputError(f"{path}: {words}")
    fractions = (values != np.round(values)) & np.isfinite(values)
    columns, per_g = with_units(table, columns, options, notes, sizes, path, whole=not fractions.any())
    if "time" in columns:
        clock = clock_with_unit(table, first, columns.pop("time"), free(), options, path, notes)
        columns |= {"time": clock} if clock else {}
    return Layout(columns, per_g, sizes[0], tuple(notes))


@dataclass(frozen=True)
class _Triple:
    """Three columns for the axes x, y, z, the meaning of their names, and size, changes and dispersion by `size_of`."""

    columns: tuple[str, ...]
    name: Name
    size: float
    changes: float
    dispersion: float

    @property
    def with_gravity(self) -> bool:
        """Whether the readings may have the size of gravity, with offsets and noise: in m/s^2 for a linear acceleration (ROS).

        A name that does not state an acceleration with gravity needs a rest at which the readings have this size."""
        linear = self.name.state == "linear"
        stated = self.name.quantity == "acceleration" and not linear
        size = may_be_gravity(self.size, self.name.unit or "ms2" * linear)
        return self.changes > _LEAST_NOISE and size and (stated or np.isfinite(self.dispersion))

    def option(self, columns: Sequence[str], more: str = "") -> str:
        """The option that selects it among all columns of a table, by number if a name needs quotation marks."""
        plain = all(re.fullmatch(r"[\w.\[\]/]*", name) and not name.isdecimal() for name in self.columns)
        names = self.columns if plain else [str(columns.index(name) + 1) for name in self.columns]
        chosen = ",".join(f"{axis}={name}" for axis, name in zip(FORCE, names, strict=True))
        return f"--columns {shlex.quote(chosen + more)}"


def _triples(columns: Sequence[str], readings: Readings) -> list[_Triple]:
    """Three columns with one quantity and one stem in their names, and axes x, y, z, or the numbers 0 to 2 or 1 to 3."""
    groups: dict[tuple, dict[str, str]] = {}
    for column in columns:
        name = parsed(column)
        if name.axis and (name.stem or name.axis in "xyz"):
            groups.setdefault((name.quantity, name.stem, name.axis.isdecimal()), {}).setdefault(name.axis, column)
    threes = [
        tuple(group[axis] for axis in sorted(group)) for group in groups.values() if "".join(sorted(group)) in _AXES
    ]
    threes.sort(key=lambda three: columns.index(three[0]))
    return [_Triple(three, parsed(three[0]), *size_of(readings(three))) for three in threes]


def _chosen(
    columns: Sequence[str], free: Sequence[str], readings: Readings, notes: list[str], path: str
) -> dict[str, Column]:
    """The accelerations with gravity, and the angular rates of the same sensor.

    Of several triples of one sensor, the least processed one with the size of gravity is used.

    **Arguments:**

    - `columns`: of the table; `free`: those without a quantity. `notes`: gets the alternatives.

    **Raises:** `InputError` with the candidates and an option for each, if names do not give one triple.
    """
    triples = _triples(free, readings)
    named = [one for one in triples if one.name.quantity == "acceleration"]
    axes_only = [one for one in triples if one.name.quantity in ("", "letter")]
    # A letter g is a rate or a multiple of g.
    plain = [one for one in axes_only if "g" not in one.name.stem]
    body = [one for one in named or plain if one.with_gravity and one.name.state not in ("free", "world")]
    if len(named) == 1 and named[0].name.state in ("raw", "", "processed"):
        # Readings far from the size of gravity may be of any unit, but not without gravity.
        body = body if named[0].size < _LEAST_GRAVITY * PER_G.get(named[0].name.unit, 1.0) else named
    # A linear acceleration is without gravity if there is another one; alone it is the name of the readings (ROS).
    body = [one for one in body if one.name.state != "linear"] or body
    several = len({one.name.sensor for one in body}) > 1 or (not named and len(body) > 1)
    if several or not body:
        found, more = body or [one for one in axes_only if one.with_gravity] + named or axes_only, ""
        words = f"name the accelerations among the columns {shown(', '.join(columns))}"
        if several:
            words = f"{len(body)} triples of columns with the size of gravity; choose one"
        elif named:
            words = f"{', '.join(named[0].columns)}: {_WITHOUT}"
        elif not axes_only:
            found, more = _proposals(columns, free[:_MOST_COLUMNS], readings)
        options = [f"{one.option(columns, more)} (size {one.size:.4g})" for one in found[:_MOST_SHOWN]]
        raise question(path, words, options or [COLUMNS_OPTION])
    force = min(body, key=lambda one: STATES.index(one.name.state))
    if others := [one for one in named if one is not force]:
        listed = "; ".join(", ".join(one.columns) for one in others[:_MOST_SHOWN])
        why, override = f"not {listed}", others[0].option(columns)
    else:
        why, override = "axes by their names", COLUMNS_OPTION
    if others or not named:
        notes.append(f"accelerations: {', '.join(force.columns)}, {why}; to override: {override}")
    rates = [one for one in triples if one.name.quantity == "rate"] or [
        one for one in axes_only if (*one.name.stem[:1], *force.name.stem[:1]) == ("g", "a")
    ]
    # The rates with most words in common with the accelerations, the least processed.
    rates.sort(key=lambda one: (-len({*one.name.stem} & {*force.name.stem}), STATES.index(one.name.state)))
    names = [*force.columns, *(rates[0].columns if rates else ())]
    return {role: Column(name, parsed(name).unit, "name") for role, name in zip((*FORCE, *RATE), names, strict=False)}


def _proposals(columns: Sequence[str], free: Sequence[str], readings: Readings) -> tuple[list[_Triple], str]:
    """Neighbouring columns whose values may be accelerations, most likely first: constant lengths of about gravity; and the
    option for a column of times."""
    values = readings(free)
    steps = np.diff(values, axis=0)
    falling, rising = np.any(steps < 0, axis=0), np.all(steps > 0, axis=0) & np.any(steps != 1, axis=0)
    found = [
        _Triple(tuple(free[k : k + 3]), Name(), *size_of(values[:, k : k + 3]))
        for k in range(len(free) - 2)
        if falling[k : k + 3].all()
    ]
    found.sort(key=lambda one: (not one.with_gravity, one.dispersion > _MOST_DISPERSION))
    unnamed = rising.any() and all(parsed(name).quantity != "time" for name in free)
    return found, f",time={columns.index(free[int(rising.argmax())]) + 1}" if unnamed else ""


def _readable(
    table: Table, first: pl.DataFrame, columns: Mapping[str, Column], path: str, notes: list[str]
) -> dict[str, Column]:
    """The columns that have numbers or need none.

    **Raises:** `InputError` for accelerations, angles, and columns named by an option, without any number.
    """
    found = dict(columns)
    checked = [role for role in (*FORCE, *RATE, "temperature", *NUMBERS) if role in columns]
    empty = [role for role in checked if not np.isfinite(columns[role].numbers(first)).any()]
    for role in empty:
        name = columns[role].name
        texts = first.select(pl.col(name).cast(pl.String).str.strip_chars(), row=ROW if ROW in first.columns else None)
        texts = texts.filter(~pl.col(name).is_in(["", "NaN"]))
        cell, row = texts.row(0) if len(texts) else ("", None)
        place = f"{table.row_word}s {row} to {texts.row(-1)[1]}, " if row else ""
        alike = [columns[axis].name for axis in FORCE if axis in empty] if role in FORCE else [name]
        what = f"{shown(cell)}: no number" if cell else "every cell is empty or NaN"
        words = f"{place}column{'s'[: len(alike) - 1]} {', '.join(alike)}: {what}"
        if role in FORCE or columns[role].why == "option" or (cell and role in NUMBERS):
            comma = re.fullmatch(r"[+-]?\d*,\d+(e[+-]?\d+)?", cell, re.IGNORECASE)
            cure = "its comma may be decimal: --decimal comma" if comma else f"{advice(cell, role)}, or give --columns"
            raise InputError(f"{path}:{words}; {cure}")
        notes += [f"{words}; ignored as {role}"] * bool(cell)
        del found[role]
    return found
