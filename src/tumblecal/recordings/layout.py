"""The quantities of the columns of a recording, from its first rows."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
import polars as pl

from tumblecal.data.cells import advice
from tumblecal.data.column_names import FORCE, NUMBERS, RATE, parsed, role_of
from tumblecal.data.text_layout import ROW
from tumblecal.ground.errors import InputError
from tumblecal.ground.option_texts import pairs
from tumblecal.ground.text_file import shown
from tumblecal.recordings.choice import chosen
from tumblecal.recordings.clock import rises
from tumblecal.recordings.clock_column import clock_among, clock_with_unit
from tumblecal.recordings.columns import COLUMNS_OPTION, Column, Layout, given_columns, is_number
from tumblecal.recordings.guesses import question
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.table import Table
from tumblecal.recordings.units import signed_words, size_of, with_units


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
        columns |= chosen(table.columns, {column.name for column in columns.values()}, readings, notes, path)
    columns |= _singles(columns, free())
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
    columns = _scaled(_readable(table, first, columns, path, notes), options)
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
        clock = clock_with_unit(table, first, columns["time"], free(), options, path, notes)
        columns = {role: column for role, column in {**columns, "time": clock}.items() if column is not None}
    return Layout(columns, per_g, sizes[0], tuple(notes))


def _singles(columns: Mapping[str, Column], free: Sequence[str]) -> dict[str, Column]:
    """Temperature, labels, angles and single axes by the names of unassigned columns; of several, the name with the fewest
    other words."""
    found: dict[str, Column] = {}
    for name in sorted(free, key=lambda name: parsed(name).foreign):
        role, unit = role_of(name)
        # Rates of another sensor are not used.
        other = role in RATE and (parsed(name).quantity != "rate" or {*RATE} & {*columns})
        if role not in ("", "time", *columns) and not other:
            found.setdefault(role, Column(name, unit, "name"))
    return found


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


def _scaled(columns: Mapping[str, Column], options: RecordingOptions) -> dict[str, Column]:
    """The columns with the scales, offsets and bits of the options."""
    found = dict(columns)
    for role in filter(found.__contains__, (*FORCE, *RATE)):
        found[role] = replace(found[role], bits=options.signed or 0)
    for option, text in (("scale", options.scale), ("offset", options.offset)):
        given = (
            pairs(f"--{option}", text, "ax=0.5,ay=0.4") if "=" in text else dict.fromkeys(FORCE, text) if text else {}
        )
        for role, number in given.items():
            value = float(number) if is_number(number) else np.nan
            if role not in found:
                raise InputError(f"--{option}: {role} is not among the columns; there are {', '.join(columns)}")
            if not np.isfinite(value) or (option == "scale" and not value):
                raise InputError(
                    f"--{option} {text}: not a finite number (a scale: other than 0); write 0.5, or ax=0.5,ay=0.4"
                )
            found[role] = replace(found[role], **{option: value})
    return found
