"""The samples of several files of one recording as one table, in the order of their dates where all have one."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tumblecal.capture.recordings.options import Asked
from tumblecal.capture.recordings.sample_file import Contents, SampleStream, sample_stream
from tumblecal.capture.recordings.units import FORCE
from tumblecal.capture.sample_table import write_frames
from tumblecal.data.joined_clocks import TIME_BEGAN, TIME_ZERO, joined_clocks
from tumblecal.data.positions import PositionSet
from tumblecal.data.table import TIME_CLOCK
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    import polars as pl

# Between files the one table's time goes on by so much, s: more than a step within a recording, so that no interval goes across.
_APART_S = 1.0
_LARGEST_RATE_RATIO = 1.2
_SAME_IN_ALL = ("serial_number", "gravity_ms2")


@dataclass(frozen=True)
class FilePart:
    """Rows `start` to `stop` of the one table, from a file; its own time zero is at `base_s` there."""

    file: Path
    contents: Contents
    start: int
    stop: int
    base_s: float


def write_files(files: Sequence[Path], out: Path, asked: Asked, *, by: str = "") -> list[FilePart]:
    """Write the samples of all files as one Parquet table, with the file's number in the column `time_clock`.

    **Returns:** the parts of the table, in its order: that of the files' dates if all have one, or as given.

    **Raises:** `InputError` with the faults of all files that cannot be read; and for files that are not of one recording: other
    units, counts, rates, serial numbers or gravity.
    """
    import polars as pl

    opened, faults = list[tuple[Path, SampleStream]](), list[str]()
    for file in files:
        try:
            stream = sample_stream(file, asked, by=by, in_force_units=True)
            frames = iter(stream.frames)
            # Its first piece shows when it began.
            opened.append((file, replace(stream, frames=chain([next(frames)], frames))))
        except InputError as fault:
            faults += fault.faults
    if faults:
        raise InputError(faults)
    if all(TIME_ZERO in stream.contents.clock_comments for _, stream in opened):
        opened.sort(key=lambda own: own[1].contents.begin_s)
    _check_alike(opened)
    first = opened[0][1]
    shared = [name for name in first.schema if all(name in stream.schema for _, stream in opened) and name != "time_s"]
    schema = {"time_s": pl.Float64, **{name: first.schema[name] for name in shared}, TIME_CLOCK: pl.String}
    kept = [key for key in first.comments if key not in ("imported_from", "rate_hz")]
    same = {key: own for key in kept if {stream.comments.get(key) for _, stream in opened} == {own := first.comments[key]}}
    parts: list[FilePart] = []
    write_frames(out, _frames(opened, list(schema), parts), pl.Schema(schema), same)
    _check_rates(parts)
    return parts


def _frames(
    opened: Sequence[tuple[Path, SampleStream]], columns: list[str], parts: list[FilePart]
) -> Iterator["pl.DataFrame"]:
    import polars as pl

    row, base = 0, 0.0
    for number, (file, stream) in enumerate(opened, start=1):
        start, last = row, base
        for frame in stream.frames:
            if "time_s" not in frame.columns:
                assert stream.contents.rate_hz is not None
                times = np.arange(row - start, row - start + len(frame)) / stream.contents.rate_hz
                frame = frame.with_columns(pl.Series("time_s", times))
            row += len(frame)
            frame = frame.with_columns(pl.col("time_s") + base, pl.lit(str(number)).alias(TIME_CLOCK)).select(columns)
            last = max(last, *frame["time_s"].tail(1))
            yield frame
        parts.append(FilePart(file, stream.contents, start, row, base))
        base = last + _APART_S


def _check_alike(opened: Sequence[tuple[Path, SampleStream]]) -> None:
    """Check that the files can be of one recording of one sensor.

    **Raises:** `InputError` naming the first that differs, and by what.
    """
    (first, one) = opened[0]
    for file, stream in opened:
        own, other = stream.contents.layout, one.contents.layout
        if own.unit != other.unit or own.per_g != other.per_g:
            raise InputError(
                f"{file}: accelerations in {_unit_words(own)}, but in {first} in {_unit_words(other)}; the files of one "
                "recording have one unit: state that of all with --unit, or convert the file"
            )
        if ("time_s" in stream.schema) != ("time_s" in one.schema):
            lacking, having = (first, file) if "time_s" in stream.schema else (file, first)
            raise InputError(f"{lacking}: no column of times, but {having} has one; name it: --columns time=...")
        if "time_s" not in stream.schema and stream.contents.rate_hz is None:
            raise InputError(f"{file}: the sample rate is not known; give --rate 100 (Hz), or --columns time=...")
        names = [[layout.columns[role].name for role in FORCE] for layout in (own, other)]
        if own.table.columns == other.table.columns and names[0] != names[1]:
            raise InputError(
                f"{file}: accelerations in the columns {', '.join(names[0])}, but in {first} in {', '.join(names[1])}; say "
                "which they are: --columns ax=...,ay=...,az=..."
            )
    for key in _SAME_IN_ALL:
        stated = {stream.comments[key]: file for file, stream in opened if key in stream.comments}
        if len(stated) > 1:
            listed = ", ".join(f"{own} in {file}" for own, file in list(stated.items())[:3])
            raise InputError(f"{key} is not the same in these files: {listed}; reduce the files of one sensor and place")


def _unit_words(layout) -> str:
    per_g = f" ({layout.per_g:g} counts a g)" if layout.per_g else ""
    return f"{layout.unit.replace('ms2', 'm/s^2')}{per_g}"


def _check_rates(parts: Sequence[FilePart]) -> None:
    rates = {part.contents.rate_hz: part.file for part in parts if part.contents.rate_hz}
    if not rates:
        raise InputError(f"{parts[0].file}: the sample rate is not known; give --rate 100 (Hz), or --columns time=...")
    if max(rates) > _LARGEST_RATE_RATIO * min(rates):
        low, high = min(rates), max(rates)
        raise InputError(
            f"{rates[high]}: {high:.4g} samples a second, but {rates[low]} has {low:.4g}; the files of one recording have one "
            "rate: reduce them apart, and diagnose with --join"
        )


def rate_of_files(parts: Sequence[FilePart]) -> float:
    """The rate of all, Hz: by the time that their samples take together."""
    rows = [(part.stop - part.start, part.contents.rate_hz) for part in parts if part.contents.rate_hz]
    return sum(count for count, _ in rows) / sum(count / rate for count, rate in rows if rate)


def with_clocks(data: PositionSet, parts: Sequence[FilePart]) -> tuple[PositionSet, str]:
    """Positions whose clock is the number of their file, with their times as `joined_clocks` has them; and how, in words."""
    assert data.time_s is not None
    of_file = np.array(data.clock if data.clock else ("1",) * len(data))
    sets, rows = [], []
    for number, part in enumerate(parts, start=1):
        own = np.flatnonzero(of_file == str(number))
        if len(own):
            rows.append(own)
            given = data.chosen(own)
            comments = {key: part.contents.clock_comments.get(key) for key in (TIME_ZERO, TIME_BEGAN)}
            comments = {key: value for key, value in comments.items() if value is not None}
            sets.append(
                replace(given, time_s=data.time_s[own] - part.base_s, clock=None, comments=comments, source=str(part.file))
            )
    clocks = joined_clocks(sets)
    assert clocks is not None and all(np.all(np.diff(own) > 0) for own in rows)
    if any(one[-1] > after[0] for one, after in pairwise(rows)):
        raise AssertionError("rows are in the order of the files")
    zero = sets[0].comments if clocks.clock is None else {}
    if len(sets) == 1:
        words = ""
    elif clocks.clock is None:
        by = "by their dates" if TIME_ZERO in zero else "whose times go on"
        words = f"one clock for all files, {by}"
    else:
        words = "the files' clocks do not go on: pauses between them are unknown, and no drift is judged across them"
    return replace(data, time_s=clocks.time_s, clock=clocks.clock, comments=data.comments | zero), words
