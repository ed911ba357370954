"""The samples of several files of one recording as one table, in the order of their clocks if these are comparable."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl

from tumblecal.capture.decoding.sample_table import write_frames
from tumblecal.data.column_names import FORCE, role_of
from tumblecal.data.joined_clocks import TIME_ZERO
from tumblecal.data.parquet import PIECE_ROWS, scan_parquet
from tumblecal.data.positions import PositionSet
from tumblecal.data.table import TIME_CLOCK
from tumblecal.ground.errors import InputError
from tumblecal.recordings.columns import COLUMNS_OPTION
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.opening import opened
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.reading import read_recording
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.units import unit_by_size


# Step of the table's time between files, s: a gap, so that no interval extends across it.
_APART_S = 1.0
_LARGEST_RATE_RATIO = 1.2
# If sizes of gravity in two attitudes differ by more than this factor, their units differ.
_LARGEST_SIZE_RATIO = 2.5
_SAME_IN_ALL = ("serial_number", "gravity_ms2")


@dataclass(frozen=True)
class FilePart:
    """Rows `start` to `stop` of the table, from a file whose time zero is at `base_s` of the table."""

    file: Path
    contents: Recording
    start: int
    stop: int
    base_s: float


@dataclass(frozen=True)
class _Written:
    """The samples of a file, as a separate table."""

    file: Path
    contents: Recording
    table: pl.LazyFrame
    rows: int
    columns: dict[str, pl.DataType]
    comments: dict[str, str]


def write_files(
    files: Sequence[Path], folder: Path, options: RecordingOptions, *, by: str = ""
) -> tuple[Path, list[FilePart]]:
    """Write the samples of all files as one Parquet table in a folder, with the file's number in the column `time_clock`.

    **Returns:** the table, and its parts in order: by the files' clocks if these are comparable, otherwise as given.

    **Raises:** `InputError` with the faults of all files that cannot be read, and for files that are not of one recording:
    different units, counts, rates, serial numbers or gravity.
    """
    try:
        written = _written(files, folder, options, by)
        with guessed(guesses_of([entry.contents for entry in written])):
            _check_alike(written)
    except InputError:
        unit = _unit_of_all(files, options, by)
        if not unit:
            raise
        written = _written(files, folder, replace(options, unit=unit), by)
        _check_alike(written)
    written = _in_time(written)
    first = written[0]
    shared = [name for name in first.columns if all(name in entry.columns for entry in written) and name != "time_s"]
    schema = {"time_s": pl.Float64(), **{name: first.columns[name] for name in shared}, TIME_CLOCK: pl.String()}
    same = {
        key: value
        for key, value in first.comments.items()
        if key not in ("imported_from", "rate_hz") and all(entry.comments.get(key) == value for entry in written)
    }
    parts: list[FilePart] = []
    path = folder / "samples.parquet"
    write_frames(path, _frames(written, list(schema), parts), pl.Schema(schema), same)
    return path, parts


def guesses_of(files: Sequence[Recording]) -> list[str]:
    """The guesses about the files, each line once."""
    return list(dict.fromkeys(line for entry in files for line in entry.layout.notes))


def _written(files: Sequence[Path], folder: Path, options: RecordingOptions, by: str) -> list[_Written]:
    written, faults = list[_Written](), list[str]()
    for number, file in enumerate(files):
        copy = folder / f"{number}.parquet"
        try:
            contents = read_recording(file, copy, options, by=by, in_g=True)
        except InputError as fault:
            faults += fault.faults
            continue
        table, rows, comments = scan_parquet(copy, check=False)
        written.append(_Written(file, contents, table, rows, dict(table.collect_schema()), comments))
    if faults:
        raise InputError(faults)
    return written


def _unit_of_all(files: Sequence[Path], options: RecordingOptions, by: str) -> str:
    """The unit of accelerations that no file states, by their median size; "" if it is ambiguous, or a file cannot be read.

    In one attitude a bias may change the size to 0.5 or 1.5 g; over several attitudes its effect is smaller.
    """
    try:
        recordings = [opened(file, options, by) for file in files]
    except InputError:
        return ""
    names = [(recording.layout.columns["ax"].name, recording.table.roles) for recording in recordings]
    stated = {role_of(roles.get(name, name))[1] for name, roles in names}
    sizes = np.array([recording.layout.size for recording in recordings])
    median = float(np.median(sizes))
    of_one_unit = sizes.max() < _LARGEST_SIZE_RATIO * median < _LARGEST_SIZE_RATIO**2 * sizes.min()
    return unit_by_size(median) if of_one_unit and not options.unit and not stated - {"", "counts"} else ""


def _in_time(written: list[_Written]) -> list[_Written]:
    """The files in the order of their clocks if they do not overlap by these; otherwise in the given order."""
    order = sorted(written, key=lambda entry: entry.contents.begin_s)
    return order if _go_on([entry.contents for entry in order]) else written


def _go_on(files: Sequence[Recording]) -> bool:
    """Whether the times of consecutive files are by one clock: dates, or a device's clock that continued."""
    begins, lasts = (np.array([getattr(entry, name) for entry in files]) for name in ("begin_s", "last_s"))
    dated = {TIME_ZERO in entry.clock_comments for entry in files}
    return len(dated) == 1 and bool(np.isfinite(begins).all() and (begins[1:] > begins[:-1] + lasts[:-1]).all())


def _frames(written: Sequence[_Written], columns: list[str], parts: list[FilePart]) -> Iterator[pl.DataFrame]:
    row, base = 0, 0.0
    for number, entry in enumerate(written, start=1):
        start, last = row, base
        for first in range(0, entry.rows, PIECE_ROWS):
            frame = entry.table.slice(first, PIECE_ROWS).collect()
            if "time_s" not in frame.columns:
                frame = frame.with_columns(
                    (pl.int_range(pl.len()) + first).cast(float).alias("time_s") / entry.contents.rate_hz
                )
            frame = frame.with_columns(pl.col("time_s") + base, pl.lit(str(number)).alias(TIME_CLOCK))
            row += len(frame)
            last = max([last, *frame["time_s"].tail(1)])
            yield frame.select(columns)
        parts.append(FilePart(entry.file, entry.contents, start, row, base))
        base = last + _APART_S


def _check_alike(written: Sequence[_Written]) -> None:
    """Check that the files can be of one recording of one sensor.

    **Raises:** `InputError` with the first file that differs, and the difference.
    """
    one, first = written[0], written[0].file
    for other in written:
        file, layout, usual = other.file, other.contents.layout, one.contents.layout
        if layout.unit != usual.unit or layout.per_g != usual.per_g:
            raise InputError(
                f"{file}: accelerations in {_unit_words(layout)}, but in {first} in {_unit_words(usual)}; the files of one "
                "recording have one unit: state that of all with --unit, or convert the file"
            )
        if ("time_s" in other.columns) != ("time_s" in one.columns):
            lacking, having = (first, file) if "time_s" in other.columns else (file, first)
            raise InputError(f"{lacking}: no column of times, but {having} has one; give it by --columns time=...")
        if other.contents.rate_hz is None:
            raise InputError(f"{file}: the sample rate is not known; give --rate 100 (Hz), or --columns time=...")
        names = [[layout.columns[role].name for role in FORCE] for layout in (layout, usual)]
        if other.contents.table.columns == one.contents.table.columns and names[0] != names[1]:
            raise InputError(
                f"{file}: accelerations in the columns {', '.join(names[0])}, but in {first} in {', '.join(names[1])}; say "
                f"which they are: {COLUMNS_OPTION}"
            )
    for key in _SAME_IN_ALL:
        stated = {entry.comments[key]: entry.file for entry in written if key in entry.comments}
        if len(stated) > 1:
            values = ", ".join(f"{value} in {file}" for value, file in list(stated.items())[:3])
            raise InputError(
                f"{key} is not the same in these files: {values}; reduce the files of one sensor and place"
            )
    rates = {entry.contents.rate_hz or 0.0: entry.file for entry in written}
    if max(rates) > _LARGEST_RATE_RATIO * min(rates):
        low, high = min(rates), max(rates)
        raise InputError(
            f"{rates[high]}: {high:.4g} samples a second, but {rates[low]} has {low:.4g}; the files of one recording have one "
            "rate: reduce them separately, and diagnose with --join"
        )


def _unit_words(layout) -> str:
    per_g = f" ({layout.per_g:g} counts a g)" if layout.per_g else ""
    return f"{layout.unit.replace('ms2', 'm/s^2')}{per_g}"


def rate_of_files(parts: Sequence[FilePart]) -> float:
    """The common rate, Hz, by the total time of their samples."""
    rows = [(part.stop - part.start, part.contents.rate_hz) for part in parts if part.contents.rate_hz]
    return sum(count for count, _ in rows) / sum(count / rate for count, rate in rows if rate)


def with_clocks(data: PositionSet, parts: Sequence[FilePart]) -> tuple[PositionSet, str]:
    """Positions with their times by one clock for all files, if there is one; and the relation of the clocks, in words.

    Otherwise the pauses between files have unknown lengths: each file has a separate clock (`PositionSet.clock`), and if none
    has two positions, there are no times.

    **Arguments:**

    - `data`: `clock` is the number of each row's file, `time_s` by the one table.
    """
    if len(parts) < 2 or data.clock is None:
        return replace(data, clock=None), ""
    contents = [part.contents for part in parts]
    if not _go_on(contents):
        words = (
            "the pauses between the files are unknown, because their clocks restart: drift is not tested across them"
        )
        timed = len(set(data.clock)) < len(data)
        return (data if timed else replace(data, time_s=None, clock=None)), words
    shift = np.array(
        [content.begin_s - contents[0].begin_s - part.base_s for content, part in zip(contents, parts, strict=True)]
    )
    assert data.time_s is not None
    time = data.time_s + shift[[int(number) - 1 for number in data.clock]]
    comments = contents[0].clock_comments
    words = f"one clock for all files: their {'dates' if TIME_ZERO in comments else 'times'} continue from file to file"
    return replace(data, time_s=time, clock=None, comments=data.comments | comments), words
