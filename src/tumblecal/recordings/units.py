"""The size of gravity in readings, and the units of accelerations and angular rates by option or by this size."""

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tumblecal.data.column_names import FORCE, RATE
from tumblecal.data.gravity_size import sphere_of
from tumblecal.data.table import DIFFERENT_UNITS
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import UNITS_PER_G
from tumblecal.ground.option_texts import pairs
from tumblecal.recordings.columns import Column, is_number
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.table import Table


# For each option the unit as this program writes it, by the units as a user writes them.
_KNOWN = {
    "--unit": {"m/s2": "ms2", "m/s^2": "ms2", "m/s²": "ms2", "ms2": "ms2", "g": "g", "mg": "mg"},
    "--gyro-unit": {"dps": "dps", "deg/s": "dps", "°/s": "dps", "rad/s": "rads", "rads": "rads"},
}
# Names of units in files, as an option is written.
AS_OPTION = {"ms2": "m/s2", "rads": "rad/s"}
PER_G = {"g": 1.0, "mg": 1000.0, "ms2": UNITS_PER_G["m/s2"]}
# Readings whose size is one g in some unit to within this factor have this unit; if several attitudes show the bias, within
# the second.
_LARGEST_RATIO, _LARGEST_RATIO_WITHOUT_BIAS = 1.3, 1.15
# Size of readings with offsets to 0.6 g, relative to gravity.
_SMALLEST, _LARGEST = 0.35, 1.9
_FEWEST_ATTITUDES, _MOST_DISPERSION, _LARGEST_OFFSET = 6, 0.05, 0.8
# Spread of a rest, and changes of lengths that need one, relative to the usual length.
_REST, _MOST_CHANGES = 0.1, 0.4
_WINDOWS, _FEWEST_ROWS, _MOST_ROWS = 2000, 12, 60
# Bits of numbers, and relative distances of lengths from the usual one that are near it and far from it.
_BITS, _NEAR, _FAR = (8, 10, 12, 14, 16, 18, 20, 24, 32), 0.7, 3.0


def stated_unit(text: str, option: str) -> tuple[str, float | None]:
    """A unit as a user writes it, as this program writes it, and its counts for one g (or dps, for `--gyro-unit`).

    **Example:** `stated_unit("16384/g", "--unit")` is `("counts", 16384.0)`.

    **Raises:** `InputError` for an unknown unit.
    """
    known, of = _KNOWN[option], {"--unit": "g", "--gyro-unit": "dps"}[option]
    plain = text.lower().replace(" ", "")
    counts = re.fullmatch(rf"(?:(?:lsb|counts)?([0-9.]+(?:e[+-]?\d+)?)(?:lsb|counts?)?/{of}|counts|lsb)", plain)
    if plain not in known and not counts:
        raise InputError(f"{option} {text}: not a unit; write {', '.join(known)}, or counts such as 16384/{of}")
    return known.get(plain, "counts"), float(counts[1]) if counts and counts[1] else None


def scaled(columns: Mapping[str, Column], options: RecordingOptions) -> dict[str, Column]:
    """The columns with the scales, offsets and bits of the options."""
    axes = (*FORCE, *RATE)
    found = {role: replace(one, bits=options.signed or 0) if role in axes else one for role, one in columns.items()}
    for option, text in (("scale", options.scale), ("offset", options.offset)):
        one_for_all = dict.fromkeys(FORCE, text) if text else {}
        for role, number in (pairs(f"--{option}", text, "ax=0.5,ay=0.4") if "=" in text else one_for_all).items():
            value = float(number) if is_number(number) else np.nan
            if role not in found:
                raise InputError(f"--{option}: {role} is not among the columns; there are {', '.join(columns)}")
            if not np.isfinite(value) or (option == "scale" and not value):
                cure = "not a finite number (a scale: other than 0); write 0.5, or ax=0.5,ay=0.4"
                raise InputError(f"--{option} {text}: {cure}")
            found[role] = replace(found[role], **{option: value})
    return found


def with_units(
    table: Table,
    columns: Mapping[str, Column],
    options: RecordingOptions,
    notes: list[str],
    sizes: tuple[float, float, float],
    path: str,
    *,
    whole: bool,
) -> tuple[dict[str, Column], float | None]:
    """The columns with the units of accelerations and rates: by option, by name or format, or the one in which the size of the
    accelerations is about one g. Rates in counts remain counts unless the counts for one deg/s are known.

    **Arguments:**

    - `sizes`: as of `size_of`. `whole`: whether the accelerations are whole numbers.

    **Returns:** the columns, and the counts for one g if the accelerations are counts and it is known.

    **Raises:** `InputError` for an unknown unit, or if the names of the axes state different ones.
    """
    (size, changes, dispersion), stated = sizes, dict[str, tuple[str, float | None, str]]()
    for roles, given, option, letter in (
        (FORCE, options.unit, "--unit", "a"),
        (RATE, options.gyro_unit, "--gyro-unit", "g"),
    ):
        there = [columns[role] for role in roles if role in columns]
        named = list(dict.fromkeys(column.unit for column in there if column.unit))
        unit, per, why = next(iter(named), ""), None, "name"
        if given:
            (unit, per), why = stated_unit(given, option), "option"
        elif len(named) > 1:
            raise InputError(f"{path}: {', '.join(column.name for column in there)} {DIFFERENT_UNITS}")
        elif unit in ("", "counts"):
            per = table.per_unit.get(letter) if letter == "g" or not options.scale else None
            why = "format" if per else "not known"
        stated[letter] = unit, per, why
    unit, per_g, why = stated["a"]
    if why == "not known":
        near = unit_by_size(size, without_bias=dispersion < changes, whole=whole) if np.isfinite(dispersion) else ""
        if unit and "counts_per_g" in table.stated:
            per_g, why = float(table.stated["counts_per_g"]), "file"
        elif near and (not unit or near.endswith("/g")):
            (unit, per_g), why = stated_unit(near, "--unit"), "size"
            notes.append(f"unit guessed: {near} (the readings' size is about {size:.5g}; to change it: --unit)")
    unit = unit or "counts"
    rate, per_dps, rate_why = stated["g"]
    if {*RATE} & {*columns} and not rate and rate_why in ("format", "not known"):
        notes.append("unit of the angular rates not known: not converted (to set it: --gyro-unit)")
    rate = "dps" if per_dps else rate or ("counts" if unit == "counts" else "raw")
    found = dict(columns)
    for role in filter(columns.__contains__, (*FORCE, *RATE)):
        column = columns[role]
        if role in FORCE:
            found[role] = replace(column, unit=unit, unit_why=why)
        else:
            found[role] = replace(column, unit=rate, unit_why=rate_why, scale=column.scale / (per_dps or 1.0))
    return found, per_g


def unit_by_size(size: float, *, without_bias: bool = False, whole: bool = True) -> str:
    """The unit in which a size of the accelerations is about one g, as a user writes it; empty for none.

    **Arguments:**

    - `without_bias`: whether the size is the radius of a sphere through readings of several attitudes. `whole`: whether they
      are whole numbers, like counts.
    """
    if not size > 0:
        return ""
    near, per = min(UNITS_PER_G.items(), key=lambda unit: abs(np.log(size / unit[1])))
    ratio = _LARGEST_RATIO_WITHOUT_BIAS if without_bias else _LARGEST_RATIO
    if not 1 / ratio < size / per < ratio:
        return ""
    return near if near in ("g", "mg", "m/s2") else f"{per:g}/g" * whole


def may_be_gravity(size: float, unit: str) -> bool:
    """Whether a size is that of gravity with offsets, in this unit or, if it is unknown, in a usual one."""
    sizes = [PER_G[unit]] if unit in PER_G else UNITS_PER_G.values()
    return any(_SMALLEST < size / one < _LARGEST for one in sizes)


def signed_words(names: list[str], values: NDArray[np.float64]) -> str:
    """The question about whole numbers (n, 3) of which negative ones are written as unsigned ones; empty for others.

    Then rows with a number in the upper half of the range have lengths far from those of the other rows (or from one g in a
    usual unit), and near them if the upper half is negative.
    """
    values = values[np.isfinite(values).all(1)]
    top = float(np.max(values, initial=0.0))
    bits = next((bits for bits in _BITS if 2.0 ** (bits - 1) <= top < 2.0**bits), 0)
    if not bits or np.min(values) < 0 or (values != np.round(values)).any():
        return ""
    upper = values >= 2.0 ** (bits - 1)
    rows = upper.any(1)
    as_written, as_signed = (np.linalg.norm(one, axis=1) for one in (values, values - 2.0**bits * upper))
    size = float(np.median(as_signed if rows.all() else as_signed[~rows]))
    away, away_signed = (float(np.median(np.abs(one[rows] / size - 1))) for one in (as_written, as_signed))
    unit = unit_by_size(size)
    if (rows.all() and not unit) or not away_signed < _NEAR < away or away <= _FAR * away_signed:
        return ""
    power = 2.0 ** np.round(np.log2(size))
    unit = unit or f"{power if 0.8 < size / power < 1.25 else round(size):g}/g"
    return (
        f"{', '.join(names)}: numbers up to {top:g} are negative ones, written as unsigned numbers of {bits} bits; to "
        f"read them: --signed {bits} --unit {unit}"
    )


def size_of(values: NDArray[np.float64]) -> tuple[float, float, float]:
    """The size of gravity in readings (n, 3), the largest relative change of nine tenths of the lengths, and the relative
    dispersion of the lengths about a bias: infinite if they show no gravity, because they change and never rest.

    The size is the radius of the sphere through the means at rest if there is one, because a bias changes the median length.
    """
    # Equal numbers on all axes are erased memory, or a sensor that does not answer.
    values = values[np.isfinite(values).all(1) & (np.ptp(values, axis=1) > 0)]
    if not len(values):
        return np.nan, np.nan, np.inf
    lengths = np.linalg.norm(values, axis=1)
    usual = float(np.median(lengths))
    changes = float(np.quantile(np.abs(lengths / usual - 1), 0.9)) if usual else np.inf
    rows = int(np.clip(len(values) // _WINDOWS, _FEWEST_ROWS, _MOST_ROWS))
    windows = values[: len(values) // rows * rows].reshape(-1, rows, 3)
    if not len(windows):
        return usual, changes, changes
    spread = windows.std(1).max(1)
    most = 3 * np.quantile(spread, 0.2) + 2e-3 * usual
    # One mean for each attitude: those that differ from all before them.
    means = np.zeros((0, 3))
    for mean in windows.mean(1)[spread <= most] / usual:
        if (np.linalg.norm(means - mean, axis=1) > 0.1).all():
            means = np.vstack([means, mean])
    # A sensor that moves all the time has no means at rest.
    if (
        len(means) >= _FEWEST_ATTITUDES
        and most < _REST * usual
        and np.linalg.matrix_rank(means - means.mean(0), 1e-5) == 3
    ):
        centre, radius = sphere_of(means)
        radii = np.linalg.norm(means - centre, axis=1)
        dispersion = float(radii.std() / radii.mean())
        if dispersion < _MOST_DISPERSION and (np.abs(centre) < _LARGEST_OFFSET * radius).all():
            return float(radii.mean()) * usual, changes, dispersion
    return usual, changes, changes if most < _REST * usual or changes < _MOST_CHANGES else np.inf
