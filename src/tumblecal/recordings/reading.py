"""The samples of a recording of any format as one table, and the facts about its clock and temperature."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.capture.decoding.sample_table import write_frames
from tumblecal.data.column_names import FORCE, LABELS
from tumblecal.data.parquet import pieces_in_order, scan_parquet
from tumblecal.ground.atomic import scratch_folder
from tumblecal.ground.errors import InputError
from tumblecal.recordings.clock import DAY_S, LONGEST_STEP_S
from tumblecal.recordings.columns import stated_rate
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.opening import opened
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.rows import WHOLE, left_out, names_of, retained_frames, sample_frames
from tumblecal.recordings.units import signed_words


# Share of the steps of a regular clock that are within a quarter of the usual one.
_REGULAR, _CHECKED_ROWS = 0.8, 20_000


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
    schema = pl.Schema({name: pl.String if name in LABELS else pl.Float64 for name in names_of(layout).values()})
    with scratch_folder(path) as folder, guessed(layout.notes):
        rows = folder / "rows.parquet"
        frames = sample_frames(table, layout, str(recording.path), recording.unread, begin)
        write_frames(rows, (frame.filter(WHOLE).select(schema.names()) for frame in frames), schema)
        if not recording.options.signed:
            _check_signed(rows, recording)
        stated = recording.options.rate or stated_rate(table)
        facts = facts_of(rows, None, stated)
        kept, records = (np.ones(0, bool), []) if means else left_out(rows, layout, facts["rate_hz"])
        for record in records:
            recording.damage.add(record)
            if record.kind == "repeats" and stated and record.rows:
                stated *= 1 - record.rows / len(kept)
        if records:
            facts = facts_of(rows, kept, stated)
        clock, first = layout.columns.get("time"), scan_parquet(rows, check=False)[0]
        begin_s = np.nan
        if clock and begin:
            begin_s = begin[0] + clock.offset * (DAY_S if clock.form else clock.scale) + table.zero_s()
            if records:
                begin_s += float(first.select("time_s").slice(int(np.argmax(kept)), 1).collect().item())
        recording = replace(recording, samples=out, begin_s=begin_s, **facts)
        pieces = retained_frames(rows, kept) if records else pieces_in_order(first)
        write_frames(out, pieces, schema, recording.comments)
    return recording


def _check_signed(samples: Path, recording: Recording) -> None:
    """Ask about numbers of which only later rows show that negative ones are written as unsigned ones."""
    columns, named = [recording.layout.columns[role] for role in FORCE], names_of(recording.layout)
    table, rows, _ = scan_parquet(samples, check=False)
    readings = (
        table.select(named[role] for role in FORCE).gather_every(max(1, rows // _CHECKED_ROWS)).collect().to_numpy()
    )
    numbers = np.round(readings / [column.scale for column in columns] + [column.offset for column in columns], 9)
    if words := signed_words([column.name for column in columns], numbers):
        raise InputError(f"{recording.path}: {words}")


def facts_of(samples: Path, kept: NDArray[np.bool_] | None, stated_hz: float | None) -> dict[str, Any]:
    """The facts about the clock and the temperature of a table of samples, as fields of `Recording`.

    **Arguments:**

    - `kept` (n,): rows to consider; None for all. `stated_hz`: the rate without times.
    """
    frame, rows, _ = scan_parquet(samples, check=False)
    names = [name for name in ("time_s", "temperature_degc") if name in frame.collect_schema().names()]
    read = frame.select(names).collect()
    if kept is not None:
        read, rows = read.filter(kept) if names else read, int(kept.sum())
    facts: dict[str, Any] = {"rows": rows, "rate_hz": stated_hz}
    if "temperature_degc" in read.columns and len(known := read["temperature_degc"].drop_nulls().drop_nans()):
        facts["temperature"] = (float(known.min()), float(known.max()), rows - len(known))  # type: ignore[arg-type]
    if "time_s" not in read.columns or not rows:
        return facts
    times = read["time_s"].to_numpy()
    steps = np.diff(times)
    gap = (steps < 0) | (steps > LONGEST_STEP_S)
    whole, long, ahead = np.where(gap, np.nan, steps), steps[steps > LONGEST_STEP_S], steps[steps > 0]
    if (total := float(np.nansum(whole))) > 0:
        facts["rate_hz"] = float(np.count_nonzero(~gap)) / total
    step = float(np.median(ahead)) if len(ahead) else 0.0
    equal = int(np.count_nonzero(steps == 0))
    if step and np.mean(np.abs(ahead - step) < step / 4) > _REGULAR:
        facts["missing"] = max(0, int((np.round(steps[steps > 1.5 * step] / step) - 1).sum()) - equal)
    parts = [
        part for part in np.array_split(whole, max(1, len(whole) // 1000)) if len(part) >= 500 and np.nansum(part) > 0
    ]
    rates = [float(1 / np.nanmean(part)) for part in parts]
    return facts | {
        "slow_hz": 1 / float(np.median(long)) if 2 * len(long) > len(steps) else None,
        "last_s": float(times[-1]),
        "gaps": tuple((float(times[k + 1]), float(steps[k])) for k in np.flatnonzero(gap)),
        "equal_times": equal,
        "mixed_rates": (min(rates), max(rates)) if rates and max(rates) > 1.2 * min(rates) else None,
    }
