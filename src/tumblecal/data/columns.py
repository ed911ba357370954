"""A checked `PositionSet` from named columns of text or numbers; all faults are found, each with its place."""

import math
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tumblecal.data.cells import beyond_words, labels_in, number_in
from tumblecal.data.conditions import temperature_faults, time_fault
from tumblecal.data.faults import Faults
from tumblecal.data.gravity_size import gravity_size, power_of_two, size_fault
from tumblecal.data.position_comments import ATTITUDES, BY_HAND, BY_HEAD, MEASURED, NOISE_MODEL, UNKNOWN, measured_at
from tumblecal.data.positions import PositionSet, attitudes_of
from tumblecal.data.table import (
    DIFFERENT_UNITS,
    KNOWN,
    LABELS,
    NUMERIC,
    TIME_CLOCK,
    Table,
    axis_columns,
    likely_meant,
    without_empty,
)
from tumblecal.ground.angle_settings import look_like_radians
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import (
    STANDARD,
    STANDARD_GRAVITY_MS2,
    UNITS,
    Gravity,
    comments_of,
    stated_gravity,
    unit_in_g,
)
from tumblecal.ground.units import LARGEST_READING_G, LARGEST_SD_G, SD_RANGE, SMALLEST_SD_G


def positions(table: Table, *, check_size: bool = True) -> PositionSet:
    """The position set of a table.

    **Arguments:**

    - `table`: with the standard names of columns (docs/files.md).
    - `check_size`: whether to reject readings whose size is not near 1 g.

    **Raises:** `InputError` with all faults (of each kind the first few and their number), each with line and column.
    """
    table = without_empty(table)
    reader = _Reader(table)
    reader.header()
    reader.faults.stop()
    # Columns that are not used may contain anything.
    ignored = (*table.ignored, *(name for name in table.columns if name not in KNOWN))
    table = reader.table = replace(
        table, columns={name: cells for name, cells in table.columns.items() if name in KNOWN}
    )
    table = reader.table = table.with_points()
    labels = {name: reader.labels(name) for name in LABELS if name in table.columns}
    numbers = {name: reader.numbers(name) for name in table.columns if name not in LABELS}
    reader.faults.stop()
    readings = np.stack([numbers[name] for name in reader.axis_columns("")], axis=-1) * reader.to_g("")
    sd_columns = reader.axis_columns("sd_")
    sd = np.stack([numbers[name] for name in sd_columns], axis=-1) * reader.to_g("sd_") if sd_columns else None
    reader.values(numbers, readings, sd, check_size)
    reader.conditions(numbers, labels["position"])
    reader.faults.stop()
    alpha, beta = attitudes_of(readings) if reader.without_angles else (numbers["alpha_deg"], numbers["beta_deg"])
    gravity = reader.gravity
    if gravity is None and reader.unit("") == "ms2":
        gravity = STANDARD
    return PositionSet(
        names=labels["position"],
        alpha_deg=alpha,
        beta_deg=beta,
        readings=readings,
        sd=sd,
        run=labels.get("run"),
        mount=labels.get("mount"),
        clock=labels.get(TIME_CLOCK) if len({*labels.get(TIME_CLOCK, ())}) > 1 else None,
        recorded_noise=(table.comments[NOISE_MODEL],) * len(readings) if NOISE_MODEL in table.comments else None,
        comments=table.comments | (comments_of(gravity) if gravity else {}),
        source=table.source,
        in_ms2=reader.unit("") == "ms2",
        ignored=ignored,
        time_s=numbers.get("time_s"),
        temperature_degc=numbers.get("temperature_degc"),
        approach=numbers.get("approach"),
        n=numbers.get("n"),
    )


class _Reader:
    """Collects the faults of one table."""

    def __init__(self, table: Table):
        self.table = table
        self.faults = Faults(table.source)

    def fault(self, row: int | np.integer, column: str, text: str) -> None:
        self.faults.add(text, f":{self.table.row_word} {self.table.lines[int(row)]}", column)

    def axis_columns(self, kind: str) -> list[str]:
        return axis_columns(self.table.columns, kind)

    def to_g(self, kind: str) -> float:
        return unit_in_g(self.unit(kind), self.gravity)

    def unit(self, kind: str) -> str:
        return self.axis_columns(kind)[0].rsplit("_", 1)[1]

    @property
    def gravity(self) -> Gravity | None:
        return stated_gravity(self.table.comments, self.table.source)

    @property
    def without_angles(self) -> bool:
        """Whether this is a hand-held set without angles."""
        stated = self.table.comments.get(ATTITUDES) == UNKNOWN
        return stated and not {"alpha_deg", "beta_deg"} & set(self.table.columns)

    def header(self) -> None:
        names = list(self.table.columns)
        header_line = f":{self.table.row_word} {self.table.header_line}"
        for name in names:
            if name not in KNOWN and (hint := self.needed_hint(name)):
                self.faults.add(f"unknown column; {hint}", header_line, name or "(no name)")
        if (given := self.table.comments.get(ATTITUDES, UNKNOWN)) not in (BY_HEAD, BY_HAND, UNKNOWN):
            self.faults.add(f"comment attitudes: {given!r}: write {BY_HEAD!r}, {BY_HAND!r} or {UNKNOWN!r}")
        if self.table.comments.get(NOISE_MODEL, "-") == "":
            self.faults.add(
                f"comment {NOISE_MODEL}: no value; run tumblecal reduce again, or delete the line to use the sd columns "
                "only"
            )
        if measured := self.table.comments.get(MEASURED):
            try:
                measured_at(measured, f"comment {MEASURED}")
            except InputError as error:
                self.faults.add(error.faults[0])
        for name in ("position",) if self.without_angles else ("position", "alpha_deg", "beta_deg"):
            if name not in names:
                hand_held = (
                    ""
                    if name == "position"
                    else f" (if the attitudes are unknown: --attitudes {UNKNOWN}, or the comment `# {ATTITUDES}: {UNKNOWN}`)"
                )
                self.faults.add(f"column {name} is missing; add it{hand_held}", header_line)
        self._axis_header(header_line, "")
        self._axis_header(header_line, "sd_")
        if not self.table.lines and not self.faults:
            self.faults.add("no rows below the header; write one row for each position")

    @property
    def lacking(self) -> list[str]:
        """Names of required columns that this table does not have; readings in all units."""
        present = set(self.table.columns)
        lacking = [name for name in ("position", "alpha_deg", "beta_deg") if name not in present]
        for kind in ("", "sd_"):
            found = self.axis_columns(kind)
            axes = [axis for axis in AXES if not any(name[1] == axis for name in found)]
            lacking += [f"a{axis}_{kind}{unit}" for axis in axes if found or not kind for unit in UNITS]
        return lacking

    def needed_hint(self, name: str) -> str:
        """Remedy for an unknown column that may be a required one; "" if it is not needed."""
        axis = _AXIS_ALONE.fullmatch(name.strip().lower())
        if axis and f"a{axis[1]}_g" in self.lacking:
            units = ", ".join(f"a{axis[1]}_{unit}" for unit in UNITS)
            return f"its unit is unknown; name it {units} (or give --columns a{axis[1]}_g={name},...)"
        if not name:
            known = f"{', '.join(LABELS + NUMERIC)}, ax_g ..., ax_sd_g ..."
            return f"name it (possible names: {known}), or remove it"
        meant = likely_meant(name, self.lacking, similarity=0.6)
        return f"did you mean {meant}?" if meant else ""

    def _axis_header(self, header_line: str, kind: str) -> None:
        found = self.axis_columns(kind)
        if kind and not found:
            return
        for axis in AXES:
            of_axis = [name for name in found if name.startswith(f"a{axis}_")]
            if len(of_axis) > 1:
                self.faults.add(f"{' and '.join(of_axis)} both give axis {axis}; keep one of them", header_line)
            unitless = {
                match[1] for name in self.table.columns if (match := _AXIS_ALONE.fullmatch(name.strip().lower()))
            }
            if not of_axis and axis not in unitless:
                self.faults.add(f"column a{axis}_{kind}g (or _mg, _ms2) is missing; add it", header_line)
        if len({name.rsplit("_", 1)[1] for name in found}) > 1 and len(found) == 3:
            self.faults.add(f"{', '.join(found)} {DIFFERENT_UNITS}", header_line)

    def numbers(self, name: str) -> np.ndarray:
        values = np.full(len(self.table.lines), math.nan)
        for row, cell in enumerate(self.table.columns[name]):
            values[row], wrong = number_in(cell, name)
            if wrong or (name in NUMERIC and (wrong := beyond_words(name, values[row]))):
                self.fault(row, name, wrong)
        return values

    def labels(self, name: str) -> tuple[str, ...]:
        """A column of labels."""
        labels = labels_in(self.table.columns[name])
        or_none = "" if name == "position" else ", or remove the whole column"
        for row in (row for row, label in enumerate(labels) if not label):
            self.fault(row, name, f"the cell is empty; write the {name} in every row{or_none}")
        return tuple(labels)

    def values(
        self, numbers: dict[str, np.ndarray], readings: np.ndarray, sd: np.ndarray | None, check_size: bool
    ) -> None:
        if sd is not None:
            for row, axis in zip(*np.nonzero((sd < SMALLEST_SD_G) | (sd > LARGEST_SD_G)), strict=True):
                name = self.axis_columns("sd_")[axis]
                self.fault(
                    row,
                    name,
                    f"{SD_RANGE}; remove the sd columns if it is not known",
                )
        for row, axis in zip(*np.nonzero(np.abs(readings) > LARGEST_READING_G), strict=True):
            name = self.axis_columns("")[axis]
            self.fault(
                row,
                name,
                f"{readings[row, axis]:.3g} g is not a possible reading; measure the position again or remove the row",
            )
        for row in np.nonzero(numbers.get("n", np.ones(1)) < 1)[0]:
            self.fault(row, "n", "a mean has at least one sample; correct it, or remove the whole column")
        for row in np.nonzero(np.abs(numbers.get("approach", np.ones(1))) != 1)[0]:
            self.fault(row, "approach", "must be +1 or -1: the sense of the last turn of the spindle")
        if not self.without_angles:
            self._degrees(numbers)
        if check_size and not self.faults:
            self._size(readings)

    def conditions(self, numbers: dict[str, np.ndarray], positions: Sequence[str]) -> None:
        for row, wrong in temperature_faults(numbers.get("temperature_degc", np.zeros(0))):
            self.fault(row, "temperature_degc", wrong)
        if wrong := time_fault(numbers.get("time_s", np.zeros(0)), positions):
            self.fault(0, "time_s", wrong)

    def _degrees(self, numbers: dict[str, np.ndarray]) -> None:
        """Add a fault for radians in a column of degrees."""
        if look_like_radians(np.concatenate([numbers["alpha_deg"], numbers["beta_deg"]])):
            self.faults.add("these look like radians; write degrees", column="alpha_deg, beta_deg")

    def _size(self, readings: np.ndarray) -> None:
        size = gravity_size(readings)
        if 0.5 < size < 2.0:
            return
        columns = self.axis_columns("")
        given = columns[0].rsplit("_", 1)[1]
        in_unit = size / self.to_g("")
        for unit, one_g in {"g": 1.0, "mg": 1000.0, "ms2": STANDARD_GRAVITY_MS2}.items():
            away = abs(np.log(in_unit / one_g))
            if away < min(np.log(2.0), abs(np.log(size / power_of_two(size)))) and unit != given:
                renamed = ", ".join(f"a{axis}_{unit}" for axis in AXES)
                self.faults.add(
                    f"the readings' norm is about {in_unit:.4g}, so they look like {'m/s^2' if unit == 'ms2' else unit}; "
                    f"name the columns {renamed}",
                    column=", ".join(columns),
                )
                return
        self.faults.add(size_fault(readings), column=", ".join(columns))


# Axes of a triad named without a unit.
_AXIS_ALONE = re.compile(r"(?:a|acc|accel|f|acceleration)[ _-]?([xyz])")
