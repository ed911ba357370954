"""Recordings over temperature of any format as one table of bins."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tumblecal.capture.capture_plan import read_plan
from tumblecal.data.positions import PositionSet
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError
from tumblecal.recordings.dwells.file_places import places_by_table
from tumblecal.recordings.dwells.join import notes_of
from tumblecal.recordings.dwells.place import Place
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.thermal.attitudes import labelled
from tumblecal.recordings.thermal.bins import BINS, binned, course_of, default_width
from tumblecal.recordings.thermal.branches import Branches
from tumblecal.recordings.thermal.position_rows import are_positions, positions_of, rows_of_positions
from tumblecal.recordings.thermal.read_series import read_series
from tumblecal.recordings.thermal.series import ThermalSeries
from tumblecal.recordings.thermal.smoothed_temperature import TemperatureCourse
from tumblecal.recordings.thermal.thermal_table import ThermalTable, joined


# The temperature is constant if it changes by less than this many resolution steps, and standard deviations of its noise.
_LEAST_STEPS, _LEAST_SD = 3.0, 4.0
# Few accelerometers are specified above this temperature, degC.
_UNUSUAL_DEGC = 125.0
# Ends of branches have one decimal on wider ranges than this.
_WIDE_DEGC = 10.0


@dataclass(frozen=True)
class ThermalReading:
    """A table with its origin: contents of each recording (`read`), findings in words, and warnings for each file."""

    table: ThermalTable
    read: tuple[Recording, ...]
    lines: tuple[str, ...]
    warnings: tuple[tuple[str, list[str]], ...]


def thermal_reading(
    paths: Sequence[Path],
    context: KnownContext = KnownContext(),
    options: RecordingOptions = RecordingOptions(),
    criterion: Criterion = Criterion(),
    *,
    bin_degc: float | None = None,
    same_attitude: bool = False,
    noise_sd: float | None = None,
    report: Callable[[str], None] = lambda text: None,
) -> ThermalReading:
    """Read recordings and position files over temperature.

    **Arguments:**

    - `paths`: recordings of any format; position files with temperatures; folders of captures. Each has its own clock.
    - `context`: known attitudes (`plan`; `table` of the files), run and mounting. `options`, `criterion`: as for `reduce`.
    - `bin_degc`: width of the bins; by default a fortieth of the range. `same_attitude`: whether attitudes of several files
      with the same direction of gravity (within 10 deg) are the same attitude. `noise_sd`: stated standard deviation of the
      readings of position files, g.
    - `report`: called with the name of each file before it is read.

    **Raises:** `InputError` for a recording that cannot be read, has no temperature, an impossible or a constant one, or no
    interval at rest.
    """
    if bin_degc is not None and not bin_degc > 0:
        raise InputError(f"width of the bins, {bin_degc:g} degC: it must be above 0")
    plan = None if context.plan is None else read_plan(context.plan)
    of_file: dict[Path, Place] = {}
    if context.table is not None:
        of_file = dict(zip(paths, places_by_table(paths, context.table, plan).places, strict=True))
    names = names_of_files(paths)
    series, means = list[ThermalSeries](), list[tuple[str, PositionSet]]()
    faults, notes, warnings = list[str](), list[str](), list[tuple[str, list[str]]]()
    for path, name in zip(paths, names, strict=True):
        report(str(path))
        try:
            if are_positions(path, context, stated=noise_sd is not None):
                means.append((name, positions_of(path, context, options, noise_sd)))
            else:
                parts, lines = read_series(path, name, (context, plan), options, criterion, of_file.get(path))
                series += parts
                warnings.append((str(path), [*parts[0].recording.damage.lines, *lines]))
        except InputError as fault:
            faults += fault.faults
            notes += getattr(fault, "__notes__", [])
    if faults:
        with guessed(notes):
            raise InputError(faults)
    if noise_sd is not None and not means:
        raise InputError(
            f"--noise-sd is for position files; {paths[0]} is a recording of samples, whose noise is measured: remove the "
            "option, or give --means if each row is the mean of a position"
        )
    read = tuple({id(one.recording): one.recording for one in series}.values())
    with guessed(notes_of(read)):
        table, lines, tables = _table(labelled(series, same=same_attitude), means, bin_degc, same=same_attitude)
    warnings += [(one.source, _unusual(one)) for one in tables if one.range_degc[1] > _UNUSUAL_DEGC]
    return ThermalReading(table, read, tuple(lines), tuple(warnings))


def names_of_files(paths: Sequence[Path]) -> list[str]:
    """Different names of files for labels: the stem, or the whole path if stems are equal."""
    stems = [path.stem or path.name for path in paths]
    return [stem if stems.count(stem) == 1 else str(path) for stem, path in zip(stems, paths, strict=True)]


def _table(
    series: Sequence[ThermalSeries],
    means: Sequence[tuple[str, PositionSet]],
    bin_degc: float | None,
    *,
    same: bool,
) -> tuple[ThermalTable, list[str], list[ThermalTable]]:
    """The rows of all sources, findings in words, and the rows of each source."""
    courses = [course_of(one) for one in series]
    width = bin_degc if bin_degc or not series else default_width(list(zip(series, courses, strict=True)))
    tables, lines, before = list[ThermalTable](), list[str](), Counter[str]()
    for one, course in zip(series, courses, strict=True):
        assert width is not None
        table, branches = binned(one, course, width, before[one.name])
        before[one.name] += len(branches.sign)
        tables.append(table)
        lines += _words(one, course, branches, table, width)
    # As for recordings, one width for all: the temperatures of a soak are not those of a ramp.
    degc = [value for _, data in means for value in np.array(data.temperature_degc, float)]
    of_means = bin_degc or max(float(np.ptp(degc or [0.0])) / BINS, 1e-6)
    several = len(means) + len(before) > 1
    for name, data in means:
        tables.append(rows_of_positions(data, name, of_means, own=several and not same))
        lines.append(f"{name}: {counted(len(data), 'position mean')}")
    source = tables[0].source + (f" and {len(tables) - 1} more" if len(tables) > 1 else "")
    table = replace(joined(tables, source), files=tuple(dict.fromkeys(one.source for one in tables)))
    _check_range(table, courses)
    return table, lines, tables


def _unusual(table: ThermalTable) -> list[str]:
    low, high = table.range_degc
    return [
        f"temperatures {low:.4g} to {high:.4g} degC: few sensors are used above {_UNUSUAL_DEGC:g} degC; if these are counts or "
        "degrees Fahrenheit, write degC"
    ]


def _check_range(table: ThermalTable, courses: Sequence[TemperatureCourse]) -> None:
    """Check that the temperature changes.

    **Raises:** `InputError` for a constant temperature.
    """
    low = min([table.range_degc[0], *(float(course.degc.min()) for course in courses)])
    high = max([table.range_degc[1], *(float(course.degc.max()) for course in courses)])
    finest = max([0.0, *(max(_LEAST_STEPS * course.resolution, _LEAST_SD * course.noise) for course in courses)])
    if high - low <= max(finest, 1e-9):
        words = (
            f"{low:.6g} degC throughout"
            if high == low
            else f"{low:.6g} to {high:.6g} degC, within its resolution and noise"
        )
        raise InputError(
            f"{table.source}: the temperature is constant ({words}): the thermometer is stuck, or nothing was heated; "
            "check the column (--columns temperature=...)"
        )
    if len(table) < 2:
        raise InputError(
            f"{table.source}: only one temperature bin at rest; record over a wider range, or give narrower bins"
        )


def _words(
    part: ThermalSeries, course: TemperatureCourse, branches: Branches, table: ThermalTable, width: float
) -> list[str]:
    """The findings on a recording, a line each."""
    places = 1 if np.ptp(course.degc) > _WIDE_DEGC else 2
    stretches = ", ".join(
        f"{text.partition(' ')[2]} {course.degc[cells].min():.{places}f} to {course.degc[cells].max():.{places}f} degC"
        for k in range(len(branches.sign))
        if len(cells := np.flatnonzero(branches.stretch == k)) and (text := branches.label(part.clock, k))
    )
    soaks = int(branches.soak.max(initial=-1)) + 1
    means = {one: table.readings[[label == one for label in table.attitude]].mean(0) for one in table.attitudes}
    listed = "; ".join(f"{one} ({', '.join(f'{value:.4f}' for value in mean)} g)" for one, mean in means.items())
    return [
        f"{part.clock}: {counted(len(table), 'row')}, bins of {width:.3g} degC",
        f"{part.clock}: branches {stretches}; {counted(soaks, 'soak')}",
        f"{part.clock}: thermometer resolution {course.resolution:.3g} degC, noise {course.noise:.2g} degC",
        f"{part.clock}: {counted(len(table.attitudes), 'attitude')}: {listed}",
    ]
