"""The samples of one or several files as one table, in the order of their clocks if these are comparable."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl

from tumblecal.capture.decoding.sample_table import write_frames
from tumblecal.capture.journal import sha256_of
from tumblecal.data.column_names import FORCE
from tumblecal.data.joined_clocks import TIME_ZERO
from tumblecal.data.parquet import pieces_in_order, scan_parquet
from tumblecal.data.positions import PositionSet
from tumblecal.data.table import TIME_CLOCK
from tumblecal.ground.errors import InputError
from tumblecal.recordings.columns import COLUMNS_OPTION
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.reading import read_recording
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.still.blocks import SLOW_STEPS


# Step of the table's time between files, s, and in steps of a slow log: a gap, so that no interval extends across it.
_APART_S, _APART_STEPS = 1.0, SLOW_STEPS + 1
_LARGEST_RATE_RATIO = 1.2
_ONE_SENSOR = "reduce the files of one sensor and place"
_REMEDIES = {
    "unit": "the files of one recording have one unit: state that of all with --unit, or convert the file",
    "times": "give it by --columns time=...",
    "serial_number": _ONE_SENSOR,
    "gravity_ms2": _ONE_SENSOR,
    "columns": f"say which they are: {COLUMNS_OPTION}",
}


@dataclass(frozen=True)
class Joined:
    """The samples of one or several recordings as one table.

    - `source`: name for faults. `samples`: the table, a Parquet file; with the number of the recording, from 1, in the column
      `time_clock` if there are several.
    - `recordings`: in the order of the table. `order`: their numbers, from 0, in the given order. `rate_hz`: their common
      rate, Hz, by the total time of the samples; None if it is unknown.
    - `bases_s`: their time zero in the table.
    """

    source: Path
    samples: Path
    recordings: tuple[Recording, ...]
    rate_hz: float | None
    order: tuple[int, ...] = (0,)
    bases_s: tuple[float, ...] = (0.0,)

    @property
    def identifier(self) -> str:
        """An identifier by the content of the files."""
        parts = [sha256_of(one.path) if one.path.is_file() else one.path.name for one in self.recordings]
        if len(parts) > 1:
            return hashlib.sha256("".join(parts).encode()).hexdigest()[:16]
        return parts[0][:16] if self.recordings[0].path.is_file() else parts[0]

    def with_clocks(self, data: PositionSet) -> tuple[PositionSet, str]:
        """Positions with their times by one clock for all files, if there is one; and the relation of the clocks, in words.

        Otherwise the pauses between files have unknown lengths: each file has a separate clock (`PositionSet.clock`), and if
        none has two positions, there are no times.

        **Arguments:**

        - `data`: `clock` is the number of each row's file, `time_s` by the one table.
        """
        first, comments = self.recordings[0], self.recordings[0].clock_comments
        if len(self.recordings) == 1:
            return replace(data, clock=None, comments=dict(data.comments) | comments), ""
        if data.clock is None or data.time_s is None:
            return data, ""
        if not _continue(self.recordings):
            words = "the pauses between the files are unknown, because their clocks restart: drift is not tested across them"
            timed = len(set(data.clock)) < len(data)
            return (data if timed else replace(data, time_s=None, clock=None)), words
        shift = np.array([one.begin_s - first.begin_s for one in self.recordings]) - self.bases_s
        time_s = data.time_s + shift[[int(number) - 1 for number in data.clock]]
        dates = "dates" if TIME_ZERO in comments else "times"
        words = f"one clock for all files: their {dates} continue from file to file"
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
        return Joined(recording.path, path, (recording,), recording.rate_hz)
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
    tables = [scan_parquet(one.samples, check=False) for one in recordings]
    names = [table.collect_schema().names() for table, *_ in tables]
    shared = [name for name in names[0] if name != "time_s" and all(name in others for others in names)]
    frames, bases_s, base, duration_s = list[pl.LazyFrame](), list[float](), 0.0, 0.0
    for number, (one, (frame, _, _)) in enumerate(zip(recordings, tables, strict=True), start=1):
        rate_hz, last_s = one.rate_hz or np.inf, one.last_s
        if not np.isfinite(last_s):
            last_s = (one.rows - 1) / rate_hz
            frame = frame.with_columns(time_s=pl.int_range(pl.len()).cast(float) / rate_hz)
        clock = pl.lit(str(number)).alias(TIME_CLOCK)
        frames.append(frame.with_columns(pl.col("time_s") + base, clock).select("time_s", *shared, TIME_CLOCK))
        bases_s.append(base)
        base, duration_s = (
            max(base, last_s + base) + max(_APART_S, _APART_STEPS / rate_hz),
            duration_s + one.rows / rate_hz,
        )
    comments = [stored.items() for *_, stored in tables]
    same = {
        key: value
        for key, value in comments[0]
        if key not in ("imported_from", "rate_hz") and all((key, value) in others for others in comments)
    }
    table, source = pl.concat(frames), Path(f"{files[0]} and {len(files) - 1} more")
    write_frames(path, pieces_in_order(table), table.collect_schema(), same)
    rate_hz = sum(one.rows for one in recordings) / duration_s
    return Joined(source, path, tuple(recordings), rate_hz, tuple(order), tuple(bases_s))


def _continue(recordings: Sequence[Recording]) -> bool:
    """Whether the times of consecutive files are by one clock: dates, or a device's clock that continued."""
    begins, lasts = (np.array([getattr(one, name) for one in recordings]) for name in ("begin_s", "last_s"))
    dated = {TIME_ZERO in one.clock_comments for one in recordings}
    return len(dated) == 1 and bool(np.isfinite(begins).all() and (begins[1:] > begins[:-1] + lasts[:-1]).all())


def _require_one_recording(recordings: Sequence[Recording]) -> None:
    """Check that the files can be of one recording of one sensor.

    **Raises:** `InputError` with the first file that differs, and the difference.
    """
    stated, rates = dict[str, tuple[str, Path]](), dict[float, Path]()
    for one in recordings:
        layout, columns = one.layout, one.layout.columns
        counts = f" ({layout.per_g:g} counts a g)" if layout.per_g else ""
        facts = {
            "unit": f"accelerations in {layout.unit.replace('ms2', 'm/s^2')}{counts}",
            "times": f"{'a' if 'time' in columns else 'no'} column of times",
        }
        facts |= {key: f"{key} {one.comments[key]}" for key in ("serial_number", "gravity_ms2") if key in one.comments}
        # Files with different headers may name the columns of one sensor differently.
        if one.table.columns == recordings[0].table.columns:
            facts["columns"] = f"accelerations in the columns {', '.join(columns[role].name for role in FORCE)}"
        for key, fact in facts.items():
            usual, path = stated.setdefault(key, (fact, one.path))
            if fact != usual:
                raise InputError(f"{one.path}: {fact}, but in {path}: {usual}; {_REMEDIES[key]}")
        if one.rate_hz is None:
            raise InputError(f"{one.path}: the sample rate is not known; give --rate 100 (Hz), or --columns time=...")
        rates[one.rate_hz] = one.path
    low, high = min(rates), max(rates)
    if high > _LARGEST_RATE_RATIO * low:
        raise InputError(
            f"{rates[high]}: {high:.4g} samples a second, but {rates[low]} has {low:.4g}; the files of one recording have one "
            "rate: reduce them separately, and diagnose with --join"
        )
