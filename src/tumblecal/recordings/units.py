"""The units of accelerations and angular rates: by option, by format or name, or by the size of gravity."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from tumblecal.data.column_names import FORCE, RATE
from tumblecal.data.table import DIFFERENT_UNITS
from tumblecal.ground.errors import InputError
from tumblecal.recordings.columns import Column
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.sizes import unit_by_size
from tumblecal.recordings.table import Table


# The unit as this program writes it, for each unit as a user writes it.
_FORCE_UNITS = {"m/s2": "ms2", "m/s^2": "ms2", "m/s²": "ms2", "ms2": "ms2", "g": "g", "mg": "mg"}
_RATE_UNITS = {"dps": "dps", "deg/s": "dps", "°/s": "dps", "rad/s": "rads", "rads": "rads"}
_KNOWN = {"--unit": (_FORCE_UNITS, "g"), "--gyro-unit": (_RATE_UNITS, "dps")}
# Names of units in files, as an option is written.
AS_OPTION = {"ms2": "m/s2", "rads": "rad/s"}


def stated_unit(text: str, option: str) -> tuple[str, float | None]:
    """A unit as a user writes it, as this program writes it, and its counts for one g (or dps, for `--gyro-unit`).

    **Example:** `stated_unit("16384/g", "--unit")` is `("counts", 16384.0)`.

    **Raises:** `InputError` for an unknown unit.
    """
    known, of = _KNOWN[option]
    plain = text.lower().replace(" ", "")
    counts = re.fullmatch(rf"(?:lsb|counts)?([0-9.]+(?:e[+-]?\d+)?)(?:lsb|counts?)?/{of}", plain)
    if plain not in known and not counts and plain not in ("counts", "lsb"):
        units = ", ".join(AS_OPTION.get(unit, unit) for unit in dict.fromkeys(known.values()))
        raise InputError(f"{option} {text}: not a unit; write {units}, or counts such as 16384/{of}")
    return known.get(plain, "counts"), float(counts[1]) if counts else None


def with_units(
    table: Table, columns: Mapping[str, Column], options: RecordingOptions, notes: list[str], *sizes: float, path: str
) -> tuple[dict[str, Column], float | None]:
    """The columns with the units of accelerations and rates: by option, by name or format, or the one in which the size of the
    accelerations is about one g. Rates in counts remain counts unless the counts for one deg/s are known.

    **Arguments:**

    - `sizes`: as of `size_of`.

    **Returns:** the columns, and the counts for one g if the accelerations are counts and it is known.

    **Raises:** `InputError` for an unknown unit, or if the names of the axes state different ones.
    """
    size, changes, dispersion = sizes
    unit, per_g, why = _stated(columns, FORCE, options.unit, "--unit", path)
    if why == "name" and unit in ("", "counts"):
        near = unit_by_size(size, without_bias=dispersion < changes)
        if "a" in table.per_unit and not options.scale:
            per_g, why = table.per_unit["a"], "format"
        elif unit and "counts_per_g" in table.stated:
            per_g, why = float(table.stated["counts_per_g"]), "file"
        elif not near or (unit and not near.endswith("/g")):
            why = "not known"
        else:
            (unit, per_g), why = stated_unit(near, "--unit"), "size"
            notes.append(f"unit guessed: {near} (the readings' size is about {size:.5g}; to change it: --unit)")
    rate, per_dps, rate_why = _stated(columns, RATE, options.gyro_unit, "--gyro-unit", path)
    if rate_why == "name" and rate in ("", "counts"):
        per_dps, rate_why = table.per_unit.get("g"), "format" if "g" in table.per_unit else "not known"
        if {*RATE} & {*columns} and not rate:
            notes.append("unit of the angular rates not known: not converted (to set it: --gyro-unit)")
    unit = unit or "counts"
    rate = "dps" if per_dps else rate or ("counts" if unit == "counts" else "raw")
    found = dict(columns)
    for role in {*FORCE, *RATE} & {*columns}:
        column, own, evidence = columns[role], *((unit, why) if role in FORCE else (rate, rate_why))
        scale = column.scale / (per_dps if per_dps and role in RATE else 1.0)
        found[role] = replace(column, unit=own, scale=scale, why=f"{column.why}; unit: {evidence}")
    return found, per_g


def _stated(
    columns: Mapping[str, Column], roles: Sequence[str], given: str, option: str, path: str
) -> tuple[str, float | None, str]:
    """The unit of some axes by an option or their names, its counts for one g or deg/s, and the evidence."""
    there = [columns[role] for role in roles if role in columns]
    named = list(dict.fromkeys(column.unit for column in there if column.unit))
    if given:
        return *stated_unit(given, option), "option"
    if len(named) > 1:
        raise InputError(f"{path}: {', '.join(column.name for column in there)} {DIFFERENT_UNITS}")
    return next(iter(named), ""), None, "name"
