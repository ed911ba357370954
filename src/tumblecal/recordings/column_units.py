"""The units of accelerations and angular rates: by option, by format or name, or by the size of gravity."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from tumblecal.data.column_names import FORCE, RATE
from tumblecal.data.table import DIFFERENT_UNITS
from tumblecal.ground.errors import InputError
from tumblecal.recordings.columns import Column
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.table import Table
from tumblecal.recordings.units import FORCE_UNITS, PER_G, RATE_UNITS, stated_unit, unit_by_size


def check_one_unit(table: Table, columns: Mapping[str, Column], roles: Sequence[str], option: str, path: str) -> None:
    """Check that the names of some axes state one unit, unless an option gives it.

    **Raises:** `InputError` with the columns of different units.
    """
    stated = [columns[role] for role in roles if role in columns and columns[role].unit]
    if not option and len({column.unit for column in stated}) > 1:
        place = path if table.header is None else f"{path}:{table.row_word} {table.header}"
        raise InputError(f"{place}: {', '.join(column.name for column in stated)} {DIFFERENT_UNITS}")


def _with_unit(
    columns: Mapping[str, Column], roles: Sequence[str], unit: str, why: str, per: float = 1.0
) -> dict[str, Column]:
    """The columns with a unit, and the evidence for it."""
    changed = {
        role: replace(columns[role], unit=unit, scale=columns[role].scale / per, why=f"{columns[role].why}; unit: {why}")
        for role in roles if role in columns
    }  # fmt: skip
    return {**columns, **changed}


def force_unit(
    table: Table, columns: Mapping[str, Column], options: RecordingOptions, size: float, notes: list[str]
) -> tuple[dict[str, Column], float | None]:
    """The unit of the accelerations: by option, by name or format, or the one in which their size is about one g."""
    named = next((columns[role].unit for role in FORCE if columns[role].unit), "")
    if options.unit:
        unit, per_g = stated_unit(options.unit, "--unit", FORCE_UNITS, "g")
        return _with_unit(columns, FORCE, unit, "option"), per_g
    if named and named != "counts":
        other = unit_by_size(size)
        if not 1 / 3 < size / PER_G[named] < 3 and other and not other.endswith("/g"):
            notes.append(
                f"unit by name: {named}, but the readings' size is about {size:.5g}, one g in {other}; to change it: --unit"
            )
        return _with_unit(columns, FORCE, named, "name"), None
    if "a" in table.per_unit and not options.scale:
        return _with_unit(columns, FORCE, "counts", "format"), table.per_unit["a"]
    if named and "counts_per_g" in table.stated:
        return _with_unit(columns, FORCE, "counts", "file"), float(table.stated["counts_per_g"])
    near = unit_by_size(size)
    if not near or (named and not near.endswith("/g")):
        return _with_unit(columns, FORCE, "counts", "not known"), None
    notes.append(f"unit guessed: {near} (the readings' size is about {size:.5g}; to change it: --unit)")
    unit, per_g = stated_unit(near, "unit", FORCE_UNITS, "g")
    return _with_unit(columns, FORCE, unit, "size"), per_g


def rate_unit(
    table: Table, columns: Mapping[str, Column], options: RecordingOptions, notes: list[str]
) -> dict[str, Column]:
    """The unit of the angular rates; counts remain counts unless the counts for one deg/s are known."""
    rates = [role for role in RATE if role in columns]
    if not rates:
        return {**columns}
    unit, per_dps = next((columns[role].unit for role in rates if columns[role].unit), ""), None
    if options.gyro_unit:
        unit, per_dps = stated_unit(options.gyro_unit, "--gyro-unit", RATE_UNITS, "dps")
    elif unit == "counts":
        per_dps = table.per_unit.get("g")
    if per_dps:
        return _with_unit(columns, rates, "dps", "option" if options.gyro_unit else "format", per_dps)
    notes += [] if unit else ["unit of the angular rates not known: not converted (to set it: --gyro-unit)"]
    why = "option" if options.gyro_unit else "name" if unit else "not known"
    return _with_unit(columns, rates, unit or ("counts" if columns["ax"].unit == "counts" else "raw"), why)
