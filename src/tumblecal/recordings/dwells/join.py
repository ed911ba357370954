"""The samples of one or several files as one table, in the order of their clocks if these are comparable."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl

from tumblecal.capture.decoding.sample_table import write_frames
from tumblecal.capture.journal import sha256_of
from tumblecal.data.column_names import FORCE
from tumblecal.data.joined_clocks import TIME_ZERO
from tumblecal.data.parquet import PIECE_ROWS, scan_parquet
from tumblecal.data.positions import PositionSet
from tumblecal.data.table import TIME_CLOCK
from tumblecal.ground.errors import InputError
from tumblecal.recordings.columns import COLUMNS_OPTION, Layout
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.reading import read_recording
from tumblecal.recordings.recording import Recording


# Step of the table's time between files, s: a gap, so that no interval extends across it.
_APART_S = 1.0
_LARGEST_RATE_RATIO = 1.2
_SAME_IN_ALL = ("serial_number", "gravity_ms2")


@dataclass(frozen=True)
class Joined:
    """The samples of one or several recordings as one table.

    - `source`: name for faults. `samples`: the table, a Parquet file; with the number of the recording, from 1, in the column
      `time_clock` if there are several.
    - `recordings`: in the order of the table. `order`: their numbers, from 0, in the given order.
    - `edges`: first row of each in the table, and the number of rows. `bases_s`: their time zero in the table.
    """

    source: Path
    samples: Path
    recordings: tuple[Recording, ...]
    order: tuple[int, ...]
    edges: tuple[int, ...]
    bases_s: tuple[float, ...] = (0.0,)

    @property
    def rate_hz(self) -> float | None:
        """The common rate, Hz, by the total time of the samples; None if it is unknown."""
        rates = [one.rate_hz for one in self.recordings]
        if len(rates) == 1:
            return rates[0]
        return self.edges[-1] / sum(map(self.length_s, range(len(rates))))

    @property
    def identifier(self) -> str:
        """An identifier by the content of the files."""
        parts = [sha256_of(one.path) if one.path.is_file() else one.path.name for one in self.recordings]
        if len(parts) > 1:
            return hashlib.sha256("".join(parts).encode()).hexdigest()[:16]
        return parts[0][:16] if self.recordings[0].path.is_file() else parts[0]

    def length_s(self, number: int) -> float:
        """Length of a recording without its gaps, s; 0 if its rate is unknown."""
        return (self.edges[number + 1] - self.edges[number]) / (self.recordings[number].rate_hz or np.inf)

    def with_clocks(self, data: PositionSet) -> tuple[PositionSet, str]:
        """Positions with their times by one clock for all files, if there is one; and the relation of the clocks, in words.

        Otherwise the pauses between files have unknown lengths: each file has a separate clock (`PositionSet.clock`), and if
        none has two positions, there are no times.

        **Arguments:**

        - `data`: `clock` is the number of each row's file, `time_s` by the one table.
        """
        first = self.recordings[0]
        if len(self.recordings) == 1:
            return replace(data, clock=None, comments=dict(data.comments) | first.clock_comments), ""
        if data.clock is None:
            return data, ""
        if not _continue(self.recordings):
            words = "the pauses between the files are unknown, because their clocks restart: drift is not tested across them"
            timed = len(set(data.clock)) < len(data)
            return (data if timed else replace(data, time_s=None, clock=None)), words
        shift = np.array([one.begin_s - first.begin_s for one in self.recordings]) - self.bases_s
        assert data.time_s is not None
        time_s = data.time_s + shift[[int(number) - 1 for number in data.clock]]
        comments = first.clock_comments
        words = (
            f"one clock for all files: their {'dates' if TIME_ZERO in comments else 'times'} continue from file to file"
        )
        return replace(data, time_s=time_s, clock=None, comments=dict(data.comments) | comments), words


def notes_of(recordings: Sequence[Recording]) -> list[str]:
    """The guesses about recordings, each line once."""
    return list(dict.fromkeys(line for one in recordings for line in one.layout.notes))


def joined(files: Sequence[Path], folder: Path, options: RecordingOptions, by: str = "") -> Joined:
    """Read files, and write their samples as one table in a folder.

    **Raises:** `InputError` with the faults of all files that cannot be read, and for files that are not of one recording:
    different units, counts, rates, serial numbers or gravity.
    """
    path = folder / "samples.parquet"
    if len(files) == 1:
        recording = read_recording(files[0], path, options, by=by, in_g=True)
        return Joined(recording.path, path, (recording,), (0,), (0, recording.rows))
    recordings, faults = list[Recording](), list[str]()
    for number, file in enumerate(files):
        try:
            recordings.append(read_recording(file, folder / f"{number}.parquet", options, by=by, in_g=True))
        except InputError as fault:
            faults += fault.faults
    if faults:
        raise InputError(faults)
    with guessed(notes_of(recordings)):
        _require_one_recording(recordings)
    order = sorted(range(len(files)), key=lambda k: recordings[k].begin_s)
    order = order if _continue([recordings[k] for k in order]) else range(len(files))
    recordings = [recordings[k] for k in order]
    schemas = [one.frame().collect_schema() for one in recordings]
    shared = [name for name in schemas[0] if name != "time_s" and all(name in schema for schema in schemas)]
    schema = pl.Schema({"time_s": pl.Float64(), **{name: schemas[0][name] for name in shared}, TIME_CLOCK: pl.String()})
    comments = [scan_parquet(one.samples, check=False)[2] for one in recordings]
    same = {
        key: value
        for key, value in comments[0].items()
        if key not in ("imported_from", "rate_hz") and all(others.get(key) == value for others in comments)
    }
    bases_s: list[float] = []
    write_frames(path, _frames(recordings, list(schema), bases_s), schema, same)
    edges = (0, *np.cumsum([one.rows for one in recordings]).tolist())
    source = Path(f"{files[0]} and {len(files) - 1} more")
    return Joined(source, path, tuple(recordings), tuple(order), edges, tuple(bases_s))


def _continue(recordings: Sequence[Recording]) -> bool:
    """Whether the times of consecutive files are by one clock: dates, or a device's clock that continued."""
    begins, lasts = (np.array([getattr(one, name) for one in recordings]) for name in ("begin_s", "last_s"))
    dated = {TIME_ZERO in one.clock_comments for one in recordings}
    return len(dated) == 1 and bool(np.isfinite(begins).all() and (begins[1:] > begins[:-1] + lasts[:-1]).all())


def _frames(recordings: Sequence[Recording], columns: list[str], bases_s: list[float]) -> Iterator[pl.DataFrame]:
    base = 0.0
    for number, one in enumerate(recordings, start=1):
        bases_s.append(base)
        last = base
        for first in range(0, one.rows, PIECE_ROWS):
            frame = one.frame().slice(first, PIECE_ROWS).collect()
            if "time_s" not in frame.columns:
                row = pl.int_range(pl.len()) + first
                frame = frame.with_columns(row.cast(float).alias("time_s") / one.rate_hz)
            frame = frame.with_columns(pl.col("time_s") + base, pl.lit(str(number)).alias(TIME_CLOCK))
            last = max([last, *frame["time_s"].tail(1)])
            yield frame.select(columns)
        base = last + _APART_S


def _require_one_recording(recordings: Sequence[Recording]) -> None:
    """Check that the files can be of one recording of one sensor.

    **Raises:** `InputError` with the first file that differs, and the difference.
    """
    first, usual = recordings[0], recordings[0].layout
    for other in recordings:
        layout = other.layout
        if (layout.unit, layout.per_g) != (usual.unit, usual.per_g):
            raise InputError(
                f"{other.path}: accelerations in {_unit_words(layout)}, but in {first.path} in {_unit_words(usual)}; the files "
                "of one recording have one unit: state that of all with --unit, or convert the file"
            )
        if ("time" in layout.columns) != ("time" in usual.columns):
            lacking, having = (first, other) if "time" in layout.columns else (other, first)
            raise InputError(
                f"{lacking.path}: no column of times, but {having.path} has one; give it by --columns time=..."
            )
        if other.rate_hz is None:
            raise InputError(f"{other.path}: the sample rate is not known; give --rate 100 (Hz), or --columns time=...")
        names = [[each.columns[role].name for role in FORCE] for each in (layout, usual)]
        if other.table.columns == first.table.columns and names[0] != names[1]:
            raise InputError(
                f"{other.path}: accelerations in the columns {', '.join(names[0])}, but in {first.path} in "
                f"{', '.join(names[1])}; say which they are: {COLUMNS_OPTION}"
            )
    for key in _SAME_IN_ALL:
        stated = {one.comments[key]: one.path for one in recordings if key in one.comments}
        if len(stated) > 1:
            values = ", ".join(f"{value} in {path}" for value, path in list(stated.items())[:3])
            raise InputError(
                f"{key} is not the same in these files: {values}; reduce the files of one sensor and place"
            )
    rates = {one.rate_hz or 0.0: one.path for one in recordings}
    low, high = min(rates), max(rates)
    if high > _LARGEST_RATE_RATIO * low:
        raise InputError(
            f"{rates[high]}: {high:.4g} samples a second, but {rates[low]} has {low:.4g}; the files of one recording have one "
            "rate: reduce them separately, and diagnose with --join"
        )


def _unit_words(layout: Layout) -> str:
    per_g = f" ({layout.per_g:g} counts a g)" if layout.per_g else ""
    return f"{layout.unit.replace('ms2', 'm/s^2')}{per_g}"
