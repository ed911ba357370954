"""A checked `PositionSet` from named columns of text or numbers; all faults are found, each with its place."""

import re
from dataclasses import replace

import numpy as np

from tumblecal.data.cells import beyond_words, labels_in, number_in
from tumblecal.data.conditions import temperature_faults, time_fault
from tumblecal.data.faults import Faults
from tumblecal.data.gravity_size import gravity_size, power_of_two, size_fault
from tumblecal.data.position_comments import ATTITUDES, BY_HAND, BY_HEAD, MEASURED, NOISE_MODEL, UNKNOWN, measured_at
from tumblecal.data.positions import PositionSet, attitudes_of
from tumblecal.data.table import (
    DEVIATIONS,
    DIFFERENT_UNITS,
    KNOWN,
    LABELS,
    NUMERIC,
    TIME_CLOCK,
    Table,
    axis_columns,
    likely_meant,
)
from tumblecal.ground.angle_settings import look_like_radians
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD, STANDARD_GRAVITY_MS2, UNITS, comments_of, stated_gravity, unit_in_g
from tumblecal.ground.units import LARGEST_READING_G, LARGEST_SD_G, SD_RANGE, SMALLEST_SD_G


_ANGLES = ("alpha_deg", "beta_deg")
_ONE_G = {"g": 1.0, "mg": 1000.0, "ms2": STANDARD_GRAVITY_MS2}
# Axes of a triad named without a unit.
_AXIS_ALONE = re.compile(r"(?:a|acc|accel|f|acceleration)[ _-]?([xyz])")


def positions(table: Table, *, check_size: bool = True) -> PositionSet:
    """The position set of a table.

    **Arguments:**

    - `table`: with the standard names of columns (docs/files.md).
    - `check_size`: whether to reject readings whose size is not near 1 g.

    **Raises:** `InputError` with all faults (of each kind the first few and their number), each with line and column.
    """
    # Optional columns that are empty in all rows are ignored; sd columns only if all are empty.
    empty = {name for name, cells in table.columns.items() if len(cells) and not any(labels_in(cells))}
    sd_names = {name for name in table.columns if name in DEVIATIONS}
    empty &= {*LABELS[1:], *NUMERIC[2:]} | (sd_names if sd_names <= empty else set())
    table = replace(table, columns={name: cells for name, cells in table.columns.items() if name not in empty})
    faults, comments = Faults(table.source), table.comments
    without_angles = comments.get(ATTITUDES) == UNKNOWN and not {*_ANGLES} & {*table.columns}
    _check_comments(comments, faults)
    _check_names(table, () if without_angles else _ANGLES, faults)
    faults.stop()

    # Columns that are not used may contain anything.
    ignored = (*table.ignored, *(name for name in table.columns if name not in KNOWN))
    table = replace(table, columns={name: cells for name, cells in table.columns.items() if name in KNOWN})
    table = table.with_points()
    labels, numbers = dict[str, tuple[str, ...]](), dict[str, np.ndarray]()
    for name, cells in table.columns.items():
        if name in LABELS:
            labels[name] = tuple(labels_in(cells))
            or_none = "" if name == "position" else ", or remove the whole column"
            words = [
                "" if label else f"the cell is empty; write the {name} in every row{or_none}" for label in labels[name]
            ]
        else:
            read = [number_in(cell, name) for cell in cells]
            numbers[name] = np.array([value for value, _ in read])
            limited = name in NUMERIC
            words = [wrong or (beyond_words(name, value) if limited else "") for value, wrong in read]
        for row, wrong in enumerate(words):
            if wrong:
                faults.add(wrong, table.line_of(row), name)
    faults.stop()

    gravity = stated_gravity(comments, table.source)
    columns, sd_columns = axis_columns(table.columns), axis_columns(table.columns, "sd_")
    unit = columns[0].rpartition("_")[2]
    to_g = [unit_in_g(name.rpartition("_")[2], gravity) for name in (columns[0], *sd_columns[:1])]
    readings = np.stack([numbers[name] for name in columns], axis=-1) * to_g[0]
    sd = np.stack([numbers[name] for name in sd_columns], axis=-1) * to_g[1] if sd_columns else None
    for name in sd_columns:
        deviations = numbers[name] * to_g[1]
        wrong_rows = (deviations < SMALLEST_SD_G) | (deviations > LARGEST_SD_G)
        faults.add_rows(table, name, wrong_rows, f"{SD_RANGE}; remove the sd columns if it is not known")
    for name, column in zip(columns, readings.T, strict=True):
        for row in np.flatnonzero(np.abs(column) > LARGEST_READING_G).tolist():
            words = f"{column[row]:.3g} g is not a possible reading; measure the position again or remove the row"
            faults.add(words, table.line_of(row), name)
    none = np.zeros(0)
    few = "a mean has at least one sample; correct it, or remove the whole column"
    faults.add_rows(table, "n", numbers.get("n", none) < 1, few)
    sense = "must be +1 or -1: the sense of the last turn of the spindle"
    faults.add_rows(table, "approach", np.abs(numbers.get("approach", none)) != 1, sense)
    if not without_angles and look_like_radians(np.concatenate([numbers[name] for name in _ANGLES])):
        faults.add("these look like radians; write degrees", column=", ".join(_ANGLES))
    if check_size and not faults and not 0.5 < (size := gravity_size(readings)) < 2.0:
        faults.add(_size_words(size, to_g[0], unit) or size_fault(readings), column=", ".join(columns))
    for row, wrong in temperature_faults(numbers.get("temperature_degc", none)):
        faults.add(wrong, table.line_of(row), "temperature_degc")
    if wrong := time_fault(numbers.get("time_s", none), labels["position"]):
        faults.add(wrong, table.line_of(0), "time_s")
    faults.stop()

    if gravity is None and unit == "ms2":
        gravity = STANDARD
    alpha, beta = attitudes_of(readings) if without_angles else (numbers[name] for name in _ANGLES)
    clock = labels.get(TIME_CLOCK)
    return PositionSet(
        names=labels["position"],
        alpha_deg=alpha,
        beta_deg=beta,
        readings=readings,
        sd=sd,
        run=labels.get("run"),
        mount=labels.get("mount"),
        clock=clock if len({*(clock or ())}) > 1 else None,
        recorded_noise=(comments[NOISE_MODEL],) * len(readings) if NOISE_MODEL in comments else None,
        comments=comments | (comments_of(gravity) if gravity else {}),
        source=table.source,
        in_ms2=unit == "ms2",
        ignored=ignored,
        time_s=numbers.get("time_s"),
        temperature_degc=numbers.get("temperature_degc"),
        approach=numbers.get("approach"),
        n=numbers.get("n"),
    )


def _check_comments(comments: dict[str, str], faults: Faults) -> None:
    if (given := comments.get(ATTITUDES, UNKNOWN)) not in (BY_HEAD, BY_HAND, UNKNOWN):
        faults.add(f"comment attitudes: {given!r}: write {BY_HEAD!r}, {BY_HAND!r} or {UNKNOWN!r}")
    if comments.get(NOISE_MODEL, "-") == "":
        words = "no value; run tumblecal reduce again, or delete the line to use the sd columns only"
        faults.add(f"comment {NOISE_MODEL}: {words}")
    if measured := comments.get(MEASURED):
        try:
            measured_at(measured, f"comment {MEASURED}")
        except InputError as error:
            faults.add(error.faults[0])


def _check_names(table: Table, angles: tuple[str, ...], faults: Faults) -> None:
    """Add a fault for each required column that is missing, and for each unknown column that may be one of them."""
    names, header = [*table.columns], f":{table.row_word} {table.header_line}"
    alone = {match[1]: name for name in names if (match := _AXIS_ALONE.fullmatch(name.strip().lower()))}
    missing = [name for name in ("position", *angles) if name not in names]
    lacking = [*missing]
    for name in missing:
        unknown = f" (if the attitudes are unknown: --attitudes {UNKNOWN}, or the comment `# {ATTITUDES}: {UNKNOWN}`)"
        faults.add(f"column {name} is missing; add it{unknown if name in _ANGLES else ''}", header)
    for kind in ("", "sd_"):
        found = axis_columns(names, kind)
        for axis in AXES if found or not kind else ():
            of_axis = [name for name in found if name[1] == axis]
            if len(of_axis) > 1:
                faults.add(f"{' and '.join(of_axis)} both give axis {axis}; keep one of them", header)
            if not of_axis:
                lacking += [f"a{axis}_{kind}{unit}" for unit in UNITS]
                if axis not in alone:
                    faults.add(f"column a{axis}_{kind}g (or _mg, _ms2) is missing; add it", header)
        if len(found) == 3 and len({name.rpartition("_")[2] for name in found}) > 1:
            faults.add(f"{', '.join(found)} {DIFFERENT_UNITS}", header)
    for axis, name in alone.items():
        if f"a{axis}_g" in lacking:
            units = ", ".join(f"a{axis}_{unit}" for unit in UNITS)
            hint = f"its unit is unknown; name it {units} (or give --columns a{axis}_g={name},...)"
            faults.add(f"unknown column; {hint}", header, name)
    for name in names:
        if not name:
            known = f"{', '.join(LABELS + NUMERIC)}, ax_g ..., ax_sd_g ..."
            faults.add(f"unknown column; name it (possible names: {known}), or remove it", header, "(no name)")
        elif name not in (*KNOWN, *alone.values()) and (meant := likely_meant(name, lacking, similarity=0.6)):
            faults.add(f"unknown column; did you mean {meant}?", header, name)
    if not table.lines and not faults:
        faults.add("no rows below the header; write one row for each position")


def _size_words(size: float, to_g: float, unit: str) -> str:
    """The fault of readings with 1 g (`size`: in g) in another unit than that of the columns; "" for other sizes."""
    away = {name: abs(np.log(size / to_g / one_g)) for name, one_g in _ONE_G.items()}
    nearest = min(away, key=lambda name: away[name])
    if nearest == unit or away[nearest] > min(np.log(2.0), abs(np.log(size / power_of_two(size)))):
        return ""
    renamed = ", ".join(f"a{axis}_{nearest}" for axis in AXES)
    like = "m/s^2" if nearest == "ms2" else nearest
    return f"the readings' norm is about {size / to_g:.4g}, so they look like {like}; name the columns {renamed}"
