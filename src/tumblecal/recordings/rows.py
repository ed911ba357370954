"""The rows of a recording as columns in SI units, in pieces, and the rows that are left out."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.data.cells import LARGEST_NUMBER
from tumblecal.data.column_names import FORCE, LABELS, NUMBERS, QUANTITIES, RATE
from tumblecal.data.parquet import scan_parquet
from tumblecal.data.text_layout import ROW
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted
from tumblecal.ground.plain_text import CONTROLS, column_from_text
from tumblecal.recordings.columns import DAY_S, Column, Layout
from tumblecal.recordings.damage import DamageRecord
from tumblecal.recordings.table import Table
from tumblecal.recordings.units import signed_words


# Whether a row has a complete reading; the columns of the source.
WHOLE, SOURCE_COLUMNS = "\x00whole", "\x00source"
# With a larger share of unreadable rows, the layout is wrong instead of single lines.
_MOST_UNREADABLE, _SHOWN = 0.2, 5
_CHECKED_ROWS = 2000
# Fewest rows with equal readings that are erased memory; most rows that are late, before the clock goes on.
_FEWEST_ERASED, _MOST_LATE = 20, 100
# Difference of the two ends of a range: -128 and 127.
_SAME_END = 0.01
# Readings of this many times the size of gravity are no readings.
_IMPOSSIBLE = 1000
# Share of equal readings among rows with one time that occur twice.
_FEWEST_EQUAL = 0.7
# Repeated samples: fewest runs of equal readings, and largest share of single ones.
_FEWEST_RUNS, _MOST_SINGLE = 50, 0.02


@dataclass
class Unread:
    """Rows without a complete reading: their number (`rows`), and the places of the `first`."""

    rows: int = 0
    first: list[int] = field(default_factory=list)


def names_of(layout: Layout) -> dict[str, str]:
    """Columns of the samples by quantity: `time_s, ax_g .., gx_dps .., temperature_degc, position ..`."""
    units = {role: f"{role}_{column.unit}" for role, column in layout.columns.items() if role in (*FORCE, *RATE)}
    names = {"time": "time_s", "temperature": "temperature_degc"} | units
    order = ("time", *(role for role in QUANTITIES if role != "time"))
    return {role: names.get(role, role) for role in order if role in layout.columns}


def schema_of(layout: Layout) -> pl.Schema:
    """The columns of the samples, in order: labels are texts, others numbers."""
    return pl.Schema({name: pl.String if name in LABELS else pl.Float64 for name in names_of(layout).values()})


def sample_frames(
    table: Table, layout: Layout, path: str, unread: Unread, begin: list[float], more: Sequence[str] = ()
) -> Iterator[pl.DataFrame]:
    """All rows in pieces, with the columns of `names_of`, `WHOLE`, `ROW` and, for `more`, `SOURCE_COLUMNS`.

    **Arguments:**

    - `unread`: counts rows without a complete reading. `begin`: gets the first time, s, which becomes zero.
    - `more`: columns of the source to retain as text or numbers.

    **Raises:** `InputError` if there are no rows, if many cannot be read, or if negative numbers are written as unsigned ones.
    """
    named, columns = names_of(layout), layout.columns
    wanted = [part.name for column in columns.values() for part in column.parts]
    needed = [role for role in (*FORCE, *RATE, "time", *NUMBERS) if role in named]
    # Numbers too large for any quantity are damage, and would overflow the sums of squares.
    numbers = [pl.col(named[role]).abs().fill_nan(np.inf) for role in needed if role != "time"]
    complete = [number < LARGEST_NUMBER for number in numbers]
    complete += [pl.col("time_s").is_finite()] if "time" in named else []
    seen, last, midnights = 0, 0.0, 0
    for piece in table.pieces(list(dict.fromkeys([*wanted, *more]))):
        frame = piece.select(
            (_label(columns[role].name) if role in LABELS else columns[role].reading()).alias(name)
            for role, name in named.items()
        )
        if not columns["ax"].bits:
            checked = piece.gather_every(1 + len(piece) // _CHECKED_ROWS)
            axes = [columns[axis].name for axis in FORCE]
            if words := signed_words(axes, np.stack([Column(axis).numbers(checked) for axis in axes], axis=1)):
                raise InputError(f"{path}: {words}")
        if "time_s" in frame.columns:
            times = frame["time_s"].drop_nans()
            begin += [] if begin else times.filter(times.abs() < LARGEST_NUMBER).head(1).to_list()
            frame = frame.with_columns(pl.col("time_s") - (begin[0] if begin else np.nan))
            if columns["time"].of_day:
                # A time of day that falls by more than half a day has passed midnight.
                known = pl.Series([last]).append(frame["time_s"].fill_nan(None)).forward_fill()
                passed = (known.diff() < -DAY_S / 2).fill_null(value=False).cum_sum().slice(1) + midnights
                frame, last, midnights = frame.with_columns(pl.col("time_s") + DAY_S * passed), known[-1], passed[-1]
        whole = frame.select(pl.all_horizontal(complete).fill_null(value=False)).to_series()
        places = piece[ROW] if ROW in piece.columns else pl.Series(np.arange(seen + 1, seen + len(piece) + 1))
        seen += len(piece)
        lost = (~whole).arg_true()
        unread.first += places.gather(lost[: _SHOWN - len(unread.first)]).to_list()
        unread.rows += len(lost)
        if len(lost) and unread.rows > max(_SHOWN, _MOST_UNREADABLE * seen):
            # Rows of erased memory, and of another sensor in the same table, have no cell that should be a number.
            cells = pl.col(columns[role].name for role in needed if not columns[role].form)
            wrong = pl.any_horizontal(cells.is_not_null() & cells.cast(pl.Float64, strict=False).is_null())
            if piece[lost].select(wrong.mean()).item() > _MOST_UNREADABLE:
                words = f"{unread.rows} of {seen} rows cannot be read as {', '.join(wanted)}"
                place = f"{path}:{table.row_word} {unread.first[0]}"
                raise InputError(f"{place}: {words}. Give the columns of the quantities by --columns")
        source = [piece.select(more).to_struct(SOURCE_COLUMNS)] if more else []
        yield frame.with_columns(whole.alias(WHOLE), places.alias(ROW), *source)
    if unread.rows == seen:
        raise InputError(f"{path}: no row has a number in each of {', '.join(wanted)}")


def _label(name: str) -> pl.Expr:
    return column_from_text(pl.col(name).cast(pl.String).str.replace_all(CONTROLS, "?"))


def left_out(samples: Path, layout: Layout, rate_hz: float | None) -> tuple[NDArray[np.bool_], list[DamageRecord]]:
    """The rows of a table of samples that are retained, (n,), and the records of the others.

    Left out are erased memory, rows that are earlier than one before them (unless the clock restarts), rows that occur twice,
    and repeats of a sample by a logger that is faster than the sensor. In erased memory, all readings stop for 20 rows or more,
    and the clock stops too or all axes have one number; that number is not the end of the range that other rows reach.
    """
    named = names_of(layout)
    channels = [named[role] for role in (*FORCE, *RATE) if role in named]
    force = pl.col(channels[:3])
    size = layout.size / (layout.per_g if layout.per_g and layout.unit == "g" else 1.0)
    x, y, z = (pl.col(named[axis]) / layout.columns[axis].scale + layout.columns[axis].offset for axis in FORCE)
    found = scan_parquet(samples, check=False)[0].select(
        same=pl.all_horizontal(pl.col(channels).eq_missing(pl.col(channels).shift(1))),
        same_force=pl.all_horizontal(force.eq_missing(force.shift(1))),
        flat=(x - y).abs() + (x - z).abs() <= 1e-9 * x.abs(),
        largest=pl.max_horizontal(force.abs()),
        time=pl.col("time_s") if "time" in named else pl.lit(None, pl.Float64),
    )
    same, same_force, flat, largest, time = (column.to_numpy() for column in found.collect(engine="streaming"))
    same_time = np.append(False, np.diff(time) == 0)
    records: list[DamageRecord] = []
    kept = np.ones(len(same), bool)

    def leave(rows: NDArray[np.bool_], kind: str, words: str, *more) -> None:
        rows = rows & kept
        if 0 < (count := int(rows.sum())) < kept.sum():
            first = int(np.argmax(rows)) + 1
            kept[rows] = False
            words = f"{counted(count, 'row')} {words}, first row {first}: left out"
            records.append(DamageRecord(kind, words, "left out", count, first, *more))

    leave(largest > _IMPOSSIBLE * size, "impossible", f"of more than {_IMPOSSIBLE} times the size of gravity")
    stopped = _long_runs(same & same_time) & (same_time.mean() < 0.5)
    flat &= _long_runs(same)
    saturated = np.isclose(largest, largest[kept & ~flat].max(initial=0.0), rtol=_SAME_END)
    leave(stopped | (flat & ~saturated), "erased", "of erased memory")
    late = kept.copy()
    late[kept] = _late(time[kept])
    leave(late, "disorder", "earlier than a row before them")
    if same_time.any() and same[same_time].mean() > _FEWEST_EQUAL and same[~same_time].mean() < 1 - _FEWEST_EQUAL:
        leave(same & same_time, "duplicates", "that occur twice, with the same time and readings")
    starts = np.flatnonzero(kept & ~same_force)
    lengths = np.diff(np.append(starts, len(kept)))
    if len(starts) > _FEWEST_RUNS and np.mean(lengths[1:-1] == 1) <= _MOST_SINGLE:
        # Runs of equal readings are one sample or, for coarse readings, several.
        ratio = float(np.mean(lengths[lengths < 1.75 * np.median(lengths)]))
        samples_of = np.maximum(np.round(lengths / ratio), 1).astype(int)
        within = np.arange(samples_of.sum()) - np.repeat(np.cumsum(samples_of) - samples_of, samples_of)
        repeats = kept.copy()
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
