"""The units of accelerations and angular rates: by option, by format or name, or by the size of gravity."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tumblecal.data.column_names import FORCE, RATE
from tumblecal.data.table import DIFFERENT_UNITS
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import UNITS_PER_G
from tumblecal.recordings.columns import Column
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.table import Table


# The unit as this program writes it, for each unit as a user writes it.
FORCE_UNITS = {"m/s2": "ms2", "m/s^2": "ms2", "m/s²": "ms2", "ms2": "ms2", "g": "g", "mg": "mg"}
RATE_UNITS = {"dps": "dps", "deg/s": "dps", "°/s": "dps", "rad/s": "rads", "rads": "rads"}
# Names of units in files, as an option is written.
AS_OPTION = {"ms2": "m/s2", "rads": "rad/s"}
PER_G = {"g": 1.0, "mg": 1000.0, "ms2": UNITS_PER_G["m/s2"]}
# Readings whose size is one g in some unit to within this factor have this unit; if several attitudes show the bias, within
# the second.
_LARGEST_RATIO, _LARGEST_RATIO_WITHOUT_BIAS = 1.3, 1.15
# Size of readings with offsets to 0.6 g, relative to gravity.
_SMALLEST, _LARGEST = 0.35, 1.9
_FEWEST_ATTITUDES, _MOST_DISPERSION, _LARGEST_OFFSET = 6, 0.05, 0.8
# Relative distances of lengths from the usual one that are near it, and how many times as far others are.
_BITS, _NEAR, _FAR = (8, 10, 12, 14, 16, 18, 20, 24, 32), 0.7, 3.0
_WINDOWS, _FEWEST_ROWS, _MOST_ROWS = 2000, 12, 60


def stated_unit(text: str, option: str, known: dict[str, str], per: str) -> tuple[str, float | None]:
    """A unit as a user writes it, as this program writes it, and its counts for one g (or dps, by `per`).

    **Example:** `stated_unit("16384/g", "--unit", FORCE_UNITS, "g")` is `("counts", 16384.0)`.

    **Raises:** `InputError` for an unknown unit.
    """
    plain = text.lower().replace(" ", "")
    counts = re.fullmatch(rf"(?:lsb|counts)?([0-9.]+(?:e[+-]?\d+)?)(?:lsb|counts?)?/{per}", plain)
    if plain not in known and not counts and plain not in ("counts", "lsb"):
        units = ", ".join(AS_OPTION.get(unit, unit) for unit in dict.fromkeys(known.values()))
        raise InputError(f"{option} {text}: not a unit; write {units}, or counts such as 16384/{per}")
    return known.get(plain, "counts"), float(counts[1]) if counts else None


def unit_by_size(size: float, *, without_bias: bool = False) -> str:
    """The unit in which a size of the accelerations is about one g, as a user writes it; empty for none.

    **Arguments:**

    - `without_bias`: whether the size is the radius of a sphere through readings of several attitudes.
    """
    if not size > 0:
        return ""
    near = min(UNITS_PER_G, key=lambda unit: abs(np.log(size / UNITS_PER_G[unit])))
    per = UNITS_PER_G[near]
    ratio = _LARGEST_RATIO_WITHOUT_BIAS if without_bias else _LARGEST_RATIO
    return (near if near in FORCE_UNITS else f"{per:g}/g") if 1 / ratio < size / per < ratio else ""


def may_be_gravity(size: float, unit: str) -> bool:
    """Whether a size is that of gravity with offsets, in this unit or, if it is unknown, in a usual one."""
    sizes = [PER_G[unit]] if unit in PER_G else UNITS_PER_G.values()
    return any(_SMALLEST < size / one < _LARGEST for one in sizes)


def signed_words(names: Sequence[str], values: NDArray[np.float64]) -> str:
    """The question about whole numbers (n, 3) of which negative ones are written as unsigned ones; empty for others.

    Then rows with a number in the upper half of the range have lengths far from those of the other rows (or from one g in a
    usual unit), and near them if the upper half is negative.
    """
    values = values[np.isfinite(values).all(1)]
    top = float(np.max(values, initial=0.0))
    if np.min(values, initial=0.0) < 0 or (values != np.round(values)).any():
        return ""
    for bits in _BITS:
        full = 2.0**bits
        if not full / 2 <= top < full:
            continue
        upper = (values >= full / 2).any(1)
        as_signed = np.linalg.norm(values - full * (values >= full / 2), axis=1)
        others = as_signed[~upper] if (~upper).any() else as_signed
        size = float(np.median(others))
        unit = unit_by_size(size)
        off, off_signed = (
            np.median(np.abs(one[upper] / size - 1)) for one in (np.linalg.norm(values, axis=1), as_signed)
        )
        if (unit or (~upper).any()) and off_signed < _NEAR < off and off > _FAR * off_signed:
            power = 2.0 ** np.round(np.log2(size))
            unit = unit or (f"{power:g}/g" if 0.8 < size / power < 1.25 else f"{size:.0f}/g")
            return (
                f"{', '.join(names)}: numbers up to {top:g} are negative ones, written as unsigned numbers of {bits} bits; to "
                f"read them: --signed {bits} --unit {unit}"
            )
    return ""


def size_of(values: NDArray[np.float64]) -> tuple[float, float, float]:
    """The size of gravity in readings (n, 3), the largest relative change of nine tenths of the lengths, and the relative
    dispersion of the lengths about a bias.

    The size is the radius of the sphere through the means at rest if there is one, because a bias changes the median length;
    |m|^2 = 2 b.m + r^2 - |b|^2 is linear in the bias b.
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
    spread = windows.std(1).max(1, initial=0.0)
    calm = windows.mean(1)[spread <= 3 * np.quantile(spread, 0.2) + 2e-3 * usual] if len(windows) else windows[:, 0]
    means = _each_once(calm, 0.1 * usual)
    if len(means) >= _FEWEST_ATTITUDES:
        matrix = np.column_stack([2 * means / usual, np.ones(len(means))])
        found, _, rank, _ = np.linalg.lstsq(matrix, ((means / usual) ** 2).sum(1), rcond=1e-6)
        radii = np.linalg.norm(means / usual - found[:3], axis=1)
        radius, dispersion = float(radii.mean()), float(radii.std() / radii.mean())
        if (
            rank == len(found)
            and dispersion < _MOST_DISPERSION
            and (np.abs(found[:3]) < _LARGEST_OFFSET * radius).all()
        ):
            return radius * usual, changes, dispersion
    return usual, changes, changes


def _each_once(means: NDArray[np.float64], least: float) -> NDArray[np.float64]:
    """The means (m, 3) that differ from all others before them by this distance."""
    found: list[NDArray[np.float64]] = []
    for mean in means[np.append(True, np.linalg.norm(np.diff(means, axis=0), axis=1) > 0)] if len(means) else means:
        if not found or (np.linalg.norm(np.array(found) - mean, axis=1) > least).all():
            found.append(mean)
    return np.array(found).reshape(-1, 3)


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
    table: Table,
    columns: Mapping[str, Column],
    options: RecordingOptions,
    size: float,
    notes: list[str],
    *,
    without_bias: bool,
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
    near = unit_by_size(size, without_bias=without_bias)
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
