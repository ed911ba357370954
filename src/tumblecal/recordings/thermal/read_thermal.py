"""Recordings over temperature of any format as one table of bins."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl

from tumblecal.capture.capture_plan import read_plan
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted
from tumblecal.recordings.dwells.file_names import stems_of
from tumblecal.recordings.dwells.join import notes_of
from tumblecal.recordings.dwells.places import places_by_table
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.still.intervals import grouped
from tumblecal.recordings.thermal.bins import binned, default_width, finest_of
from tumblecal.recordings.thermal.position_rows import positions_of, with_branches
from tumblecal.recordings.thermal.series import ThermalSeries, read_series
from tumblecal.recordings.thermal.thermal_table import READINGS, ThermalTable, joined


# Few accelerometers are specified above this temperature, degC.
_UNUSUAL_DEGC = 125.0


@dataclass(frozen=True)
class ThermalReading:
    """A table with its origin: contents of each recording (`read`), findings in words, and warnings for each file."""

    table: ThermalTable
    read: list[Recording]
    lines: list[str]
    warnings: list[tuple[str, list[str]]]


def thermal_reading(
    paths: Sequence[Path],
    context: KnownContext = KnownContext(),
    options: RecordingOptions = RecordingOptions(),
    criterion: Criterion = Criterion(),
    *,
    bin_degc: float | None = None,
    same_attitude: bool = False,
    noise_sd: float | None = None,
) -> ThermalReading:
    """Read recordings and position files over temperature.

    **Arguments:**

    - `paths`: recordings of any format; position files with temperatures; folders of captures. Each has its own clock.
    - `context`: known attitudes (`plan`; `table` of the files), run and mounting. `options`, `criterion`: as for `reduce`.
    - `bin_degc`: width of the bins; by default a fortieth of the range. `same_attitude`: whether attitudes of several files
      with the same direction of gravity (within 10 deg) are the same attitude. `noise_sd`: stated standard deviation of the
      readings of position files, g.

    **Raises:** `InputError` for a recording that cannot be read, has no temperature, an impossible or a constant one, or no
    interval at rest.
    """
    if bin_degc is not None and not bin_degc > 0:
        raise InputError(f"width of the bins, {bin_degc:g} degC: it must be above 0")
    plan = None if context.plan is None else read_plan(context.plan)
    places = places_by_table(paths, context.table, plan).places if context.table else [None] * len(paths)
    read, series, positions = list[Recording](), list[ThermalSeries](), list[ThermalTable]()
    faults, notes, warnings = list[str](), list[str](), list[tuple[str, list[str]]]()
    for path, name, place in zip(paths, stems_of(paths), places, strict=True):
        prefix = f"{name}:" if len(paths) > 1 else ""
        try:
            rows = positions_of(path, name, prefix, context, options, noise_sd)
            if rows is not None:
                positions.append(rows)
            else:
                recording, parts, lines = read_series(path, name, prefix, (context, plan), options, criterion, place)
                series += parts
                read.append(recording)
                warnings.append((str(path), [*recording.damage.lines, *lines]))
        except InputError as fault:
            faults += fault.faults
            notes += getattr(fault, "__notes__", [])
    if faults:
        with guessed(notes):
            raise InputError(faults)
    if noise_sd is not None and not positions:
        raise InputError(
            f"--noise-sd is for position files; {paths[0]} is a recording of samples, whose noise is measured: remove the "
            "option, or give --means if each row is the mean of a position"
        )
    with guessed(notes_of(read)):
        # One width for all: the temperatures of a soak in a file are not those of a ramp.
        degc = np.concatenate(
            [one.blocks["temperature_degc"] for one in series] + [one.temperature_degc for one in positions]
        )
        width = bin_degc or default_width(degc, series)
        bins = [(one, *binned(one, width)) for one in series]
        table = joined([*(rows for _, rows, _ in bins), *(with_branches(one, width) for one in positions)])
        if len(table) < 2 or np.ptp(degc) <= finest_of(series):
            raise InputError(
                f"{table.source}: {degc.min():.6g} to {degc.max():.6g} degC at rest, in {len(table)} bins, show no change "
                "of the temperature: the thermometer is stuck or too noisy, nothing was heated, or the recording is too short. "
                "Check the column (--columns temperature=...), record longer and over a wider range, or give narrower bins "
                "(--bin-width)"
            )
        if same_attitude and len(paths) > 1 and not table.known_attitudes:
            # One label for each direction of gravity.
            means = table.means_by_attitude
            labels = [f"a{k + 1}" for k in grouped(means.select(READINGS).to_numpy())[0]]
            table = replace(
                table, frame=table.frame.with_columns(pl.col("position").replace(means["position"], labels))
            )
    lines = [line for found in bins for line in _words(*found, width)]
    lines += [f"{one.source}: {counted(len(one), 'position mean')}" for one in positions]
    if degc.max() > _UNUSUAL_DEGC:
        unusual = (
            f"temperatures up to {degc.max():.4g} degC: few sensors are used above {_UNUSUAL_DEGC:g} degC; if these are counts "
            "or degrees Fahrenheit, write degC"
        )
        warnings.append((table.source, [unusual]))
    return ThermalReading(table, read, lines, warnings)


def _words(one: ThermalSeries, table: ThermalTable, course: pl.DataFrame, width: float) -> list[str]:
    """The findings on a recording, a line each."""
    degc = pl.col("temperature_degc")
    ranges = course.group_by("branch", maintain_order=True).agg(low=degc.min(), high=degc.max()).rows()
    attitudes = table.means_by_attitude.rows()
    branches = ", ".join(f"{branch} {low:.1f} to {high:.1f} degC" for branch, low, high in ranges)
    means = "; ".join(f"{label} ({x:.4f}, {y:.4f}, {z:.4f} g)" for label, x, y, z in attitudes)
    return [
        f"{one.clock}: {counted(len(table), 'row')}, bins of {width:.3g} degC; thermometer resolution {one.resolution:.3g} "
        f"degC, noise {one.noise:.2g} degC",
        f"{one.clock}: branches {branches}; {counted(int((course['soak'].unique() >= 0).sum()), 'soak')}",
        f"{one.clock}: {counted(len(attitudes), 'attitude')}: {means}",
    ]
