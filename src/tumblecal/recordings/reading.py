"""The samples of a recording of any format as one table, and the facts about its clock and temperature."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.capture.decoding.sample_table import write_frames
from tumblecal.data.parquet import pieces_in_order, scan_parquet
from tumblecal.ground.atomic import scratch_folder
from tumblecal.recordings.clock import LONGEST_STEP_S, regular
from tumblecal.recordings.columns import DAY_S, stated_rate
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.opening import opened
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.rows import WHOLE, left_out, sample_frames, schema_of


# Rows of a local rate.
_PART_ROWS = 1000


def read_recording(
    path: Path,
    out: Path,
    options: RecordingOptions = RecordingOptions(),
    *,
    by: str = "",
    in_g: bool = False,
    means: bool = False,
) -> Recording:
    """Read a recording of any format, and write its samples as one table (Parquet, or CSV by the name of `out`).

    **Arguments, raises:** as `opened`; `means`: rows are means instead of samples, and none is left out as damage.

    **Example:** `read_recording(Path("log.csv"), Path("samples.parquet"), RecordingOptions(unit="m/s2")).rate_hz`
    """
    recording = opened(path, options, by, in_g=in_g)
    table, layout, begin = recording.table, recording.layout, list[float]()
    schema = schema_of(layout)
    with scratch_folder(path) as folder, guessed(layout.notes):
        rows = folder / "rows.parquet"
        frames = sample_frames(table, layout, str(recording.path), recording.unread, begin)
        write_frames(rows, (frame.filter(WHOLE).select(schema.names()) for frame in frames), schema)
        stated = recording.options.rate or stated_rate(table)
        frame, count, _ = scan_parquet(rows, check=False)
        kept = np.ones(count, bool)
        facts = facts_of(frame, kept, stated)
        records = []
        if not means:
            kept, records = left_out(rows, layout, facts["rate_hz"])
        for record in records:
            recording.damage.add(record)
            if record.kind == "repeats" and stated and record.rows:
                stated *= 1 - record.rows / count
        pieces, zero_s = pieces_in_order(frame), 0.0
        if records:
            facts = facts_of(frame, kept, stated)
            if "time_s" in schema:
                zero_s = float(frame.select("time_s").slice(int(np.argmax(kept)), 1).collect().item())
            pieces = _retained(frame, kept, zero_s)
        if (clock := layout.columns.get("time")) and begin:
            offset = sum(part.offset * (DAY_S if part.form else part.scale) for part in clock.parts)
            facts["begin_s"] = begin[0] + offset + table.zero_s() + zero_s
        recording = replace(recording, samples=out, **facts)
        write_frames(out, pieces, schema, recording.comments)
    return recording


def _retained(frame: pl.LazyFrame, kept: NDArray[np.bool_], zero_s: float) -> Iterator[pl.DataFrame]:
    """The rows of a table of samples that are retained, in pieces; the first time becomes zero."""
    first = 0
    for piece in pieces_in_order(frame):
        rows, first = piece.filter(kept[first : first + len(piece)]), first + len(piece)
        yield rows.with_columns(pl.col("^time_s$") - zero_s)


def facts_of(frame: pl.LazyFrame, kept: NDArray[np.bool_], stated_hz: float | None) -> dict[str, Any]:
    """The facts about the clock and the temperature of a table of samples, as fields of `Recording`.

    **Arguments:**

    - `kept` (n,): rows to consider. `stated_hz`: the rate without times.
    """
    read = frame.select("^time_s$", "^temperature_degc$").collect()
    read = read.filter(kept) if read.width else read
    facts: dict[str, Any] = {"rows": int(kept.sum()), "rate_hz": stated_hz}
    if "temperature_degc" in read.columns and len(known := read["temperature_degc"].drop_nulls().drop_nans()):
        facts["temperature"] = (known.min(), known.max(), len(read) - len(known))
    if "time_s" not in read.columns or not len(read):
        return facts
    times = read["time_s"].to_numpy()
    steps = np.diff(times)
    long, ahead, equal = steps[steps > LONGEST_STEP_S], steps[steps > 0], int(np.count_nonzero(steps == 0))
    gap = (steps < 0) | (steps > LONGEST_STEP_S)
    whole = np.where(gap, np.nan, steps)
    if (total := float(np.nansum(whole))) > 0:
        facts["rate_hz"] = float(np.count_nonzero(~gap)) / total
    if regular(ahead):
        step = np.median(ahead)
        facts["missing"] = max(0, int((np.round(steps[steps > 1.5 * step] / step) - 1).sum()) - equal)
    parts = np.array_split(whole, max(1, len(whole) // _PART_ROWS))
    rates = [float(1 / np.nanmean(part)) for part in parts if 2 * len(part) >= _PART_ROWS and np.nansum(part) > 0]
    return facts | {
        "slow_hz": 1 / float(np.median(long)) if 2 * len(long) > len(steps) else None,
        "last_s": float(times[-1]),
        "gaps": tuple((float(times[k + 1]), float(steps[k])) for k in np.flatnonzero(gap)),
        "equal_times": equal,
        "mixed_rates": (min(rates), max(rates)) if rates and max(rates) > 1.2 * min(rates) else None,
    }
