"""Rows of samples that are damaged and left out: impossible readings, erased memory, disorder, duplicates, repeats."""

from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.data.column_names import FORCE, RATE
from tumblecal.data.parquet import scan_parquet
from tumblecal.ground.counted import counted
from tumblecal.recordings.columns import Layout
from tumblecal.recordings.damage import DamageRecord
from tumblecal.recordings.rows import names_of


# Fewest rows with equal readings that are erased memory; most rows that are late, before the clock goes on.
_FEWEST_ERASED, _MOST_LATE = 20, 100
# Readings of this many times the size of gravity are no readings.
_IMPOSSIBLE = 1000
# Share of equal readings among rows with one time that occur twice.
_FEWEST_EQUAL = 0.7
# Repeated samples: fewest runs of equal readings, and largest share of single ones.
_FEWEST_RUNS, _MOST_SINGLE = 50, 0.02


def left_out(samples: Path, layout: Layout, rate_hz: float | None) -> tuple[NDArray[np.bool_], list[DamageRecord]]:
    """The rows of a table of samples that are retained, (n,), and the records of the others.

    Left out are erased memory (all readings stop for 20 rows or more, and the clock too or all axes have one number), rows
    that are earlier than one before them (unless the clock restarts), rows that occur twice, and repeats of a sample by
    a logger that is faster than the sensor.
    """
    named = names_of(layout)
    channels = [named[role] for role in (*FORCE, *RATE) if role in named]
    timed = "time_s" in named.values()
    force = pl.col(channels[:3])
    size = layout.size / (layout.per_g if layout.per_g and layout.unit == "g" else 1.0)
    numbers = [pl.col(named[role]) / layout.columns[role].scale + layout.columns[role].offset for role in FORCE]
    facts = scan_parquet(samples, check=False)[0].select(
        pl.all_horizontal(pl.col(name) == pl.col(name).shift(1) for name in channels)
        .fill_null(value=False)
        .alias("same"),
        pl.all_horizontal(force == force.shift(1)).fill_null(value=False).alias("same_force"),
        pl.any_horizontal(force.abs() > _IMPOSSIBLE * size).alias("impossible"),
        ((numbers[0] - numbers[1]).abs() + (numbers[0] - numbers[2]).abs() <= 1e-9 * numbers[0].abs()).alias("flat"),
        (pl.col("time_s") if timed else pl.int_range(pl.len()).cast(pl.Float64)).alias("time"),
    )
    facts = facts.collect(engine="streaming")
    same, flat, time = (facts[name].to_numpy() for name in ("same", "flat", "time"))
    same_time = np.append(False, np.diff(time) == 0) if timed else np.zeros(len(same), bool)
    records: list[DamageRecord] = []
    kept = np.ones(len(same), bool)

    def leave(rows: NDArray[np.bool_], kind: str, words: str, largest: float | None = None, unit: str = "") -> None:
        rows = rows & kept
        if (count := int(rows.sum())) and count < kept.sum():
            first = int(np.argmax(rows)) + 1
            kept[rows] = False
            words = f"{counted(count, 'row')} {words}, first row {first}: left out"
            records.append(DamageRecord(kind, words, "left out", count, first, largest, unit))

    leave(facts["impossible"].to_numpy(), "impossible", f"of more than {_IMPOSSIBLE} times the size of gravity")
    leave(
        _long_runs(same & same_time) & (np.mean(same_time) < 0.5) | (_long_runs(same) & flat),
        "erased",
        "of erased memory",
    )
    if timed:
        late = np.zeros(len(kept), bool)
        late[kept] = _late(time[kept])
        leave(late, "disorder", "earlier than a row before them")
        if same_time.any() and np.mean(same[same_time]) > _FEWEST_EQUAL and np.mean(same[~same_time]) < 1 - _FEWEST_EQUAL:
            leave(same & same_time, "duplicates", "that occur twice, with the same time and readings")
    starts = np.flatnonzero(kept & ~facts["same_force"].to_numpy())
    lengths = np.diff(np.append(starts, len(kept)))
    if len(starts) > _FEWEST_RUNS and np.mean(lengths[1:-1] == 1) <= _MOST_SINGLE:
        ratio = float(np.mean(lengths[lengths < 1.75 * np.median(lengths)]))
        samples_of = np.maximum(np.round(lengths / ratio), 1).astype(int)
        within = np.arange(samples_of.sum()) - np.repeat(np.cumsum(samples_of) - samples_of, samples_of)
        repeats = np.ones(len(kept), bool)
        repeats[np.repeat(starts, samples_of) + (within * ratio).astype(int)] = False
        rate = f" ({rate_hz / ratio:.4g} samples a second in {rate_hz:.4g} rows)" if rate_hz else ""
        leave(repeats, "repeats", f"that repeat a sample{rate}, each {ratio:.3g} times", ratio, "rows a sample")
    return kept, records


def _long_runs(flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The rows of runs of `_FEWEST_ERASED` rows or more that equal the row before, with the first of each run."""
    starts = np.flatnonzero(~flags)
    lengths = np.diff(np.append(starts, len(flags)))
    return np.repeat(lengths >= _FEWEST_ERASED, lengths)


def _late(time: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Rows that are earlier than one before them; after `_MOST_LATE` such rows the clock has restarted."""
    late = np.zeros(len(time), bool)
    begin, latest = 0, np.maximum.accumulate(time)
    for back in (np.flatnonzero(np.diff(time) < 0) + 1).tolist():
        if late[back]:
            continue
        on_time = np.flatnonzero(time[back : back + _MOST_LATE + 1] > latest[back - 1 - begin])
        if len(on_time) or len(time) - back <= _MOST_LATE:
            late[back : back + (on_time[0] if len(on_time) else _MOST_LATE)] = True
        else:
            begin, latest = back, np.maximum.accumulate(time[back:])
    return late
