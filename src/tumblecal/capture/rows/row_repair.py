"""Repair of rows of a recording that are not samples, are not in the order of their clock, or repeat the sample before.

Each kind is searched in the samples on disk, in this order, and the table is written again only if one is found:

1. *Erased memory.* Rows in which all readings and the clock stop, in a run of 20 or more that is also ten times as long as a
   usual packet (rows with one time), and twice as long as the longest packet in which readings change; unless the clock
   catches up in as many rows before and after, as for a late packet. If there is no clock, or it continues: 20 rows or
   more in which nothing changes and all axes have one number whose size is not that of gravity (0, or all bits set).
2. *Disorder* (`row_order`).
3. *Repeats.* The logger was k times as fast as the sensor if readings almost never change sooner than k rows after the last
   change, although independent changes would (a quiet sensor with coarse steps changes at any distance). One row of each
   sample is retained.
4. *Duplicates.* Rows that equal the row before, including the time, if nearly all rows with the time of the row before do so
   (rows of a packet, or of one ms, differ) and other rows seldom equal the row before.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.capture.recordings.damage import DamageRecord
from tumblecal.capture.rows.row_order import RowOrder, order_by_clock
from tumblecal.capture.rows.row_runs import FEWEST_ERASED, TIME, RowRuns, runs_of
from tumblecal.capture.still.blocks import stretches_of
from tumblecal.data.parquet import PARQUET_ROWS, scan_parquet
from tumblecal.ground.counted import counted


_PACKETS = 10
# Fewest changes of the readings in a packet of samples; erased memory after the last row has one change.
_CHANGES = 3
# Readings whose size differs from the usual one by more than this share are not gravity.
_NO_GRAVITY = 0.5
# Fewest changes of the readings that show the number of rows of a sample, and fewest expected earlier changes.
_FEWEST_CHANGES, _FEWEST_EXPECTED = 30, 10
_SELDOM = 0.05
# Duplicates: this share of the rows with the time of the row before equals it, and at most this share of the others.
_EQUAL, _ALIKE = 0.95, 0.3
_MOST_REPEATS = 64


@dataclass(frozen=True)
class Repair:
    """A repair: the remaining `rows`, in order; the records of the damage; `samples_per_row`, below 1 if rows repeat."""

    rows: NDArray[np.int64]
    records: tuple[DamageRecord, ...]
    samples_per_row: float = 1.0


def repairs() -> tuple[Callable[[RowRuns], Repair | None], ...]:
    """The search for each kind of damage, in order."""
    return without_erased, in_order, one_of_each, without_duplicates


def without_erased(runs: RowRuns) -> Repair | None:
    """The rows without those of erased memory."""
    starts, lengths = runs_of(runs.same)
    long = np.flatnonzero(lengths >= FEWEST_ERASED)
    if not len(long):
        return None
    erased = np.zeros(len(runs), bool)
    stopped = _stopped(runs)
    for start, length in stopped:
        erased[start : start + length] = True
    patterns = _patterns(runs, starts[long]) & ~erased[starts[long]]
    for start, length in zip(starts[long][patterns].tolist(), lengths[long][patterns].tolist(), strict=True):
        erased[start : start + length] = True
    count = int(erased.sum())
    if not count or count == len(runs):
        return None
    first = int(np.argmax(erased))
    why = (
        "the clock and all readings stop"
        if stopped
        else "nothing changes, and all axes have one number that is not gravity"
    )
    return Repair(np.flatnonzero(~erased), (erased_record(count, first + 1, why),))


def erased_record(rows: int, first: int, why: str) -> DamageRecord:
    """The record of rows of erased memory; `first` is the first of them, from 1."""
    finding = f"{counted(rows, 'row')} of erased memory, first row {first} ({why})"
    return DamageRecord("erased", finding, "left out", "left out", rows, first)


def _stopped(runs: RowRuns) -> list[tuple[int, int]]:
    """Runs (first row, rows) in which all readings and the clock stop."""
    if not runs.timed:
        return []
    begun, packets = runs_of(runs.same_time)
    changes = np.add.reduceat((runs.same_time & ~runs.same).astype(np.int64), begun)
    longest = int(packets[changes >= _CHANGES].max(initial=0))
    fewest = max(FEWEST_ERASED, _PACKETS * float(np.median(packets)), 2 * longest)
    starts, lengths = runs_of(runs.same & runs.same_time)
    long = lengths >= fewest
    starts, lengths = starts[long], lengths[long]
    if not len(starts):
        return []
    times = runs.times()
    ahead = np.diff(times)
    step = float(np.median(ahead[ahead > 0])) if (ahead > 0).any() else np.inf
    # The clock catches up a late packet within as many rows before and after; rows of erased memory are in excess.
    first, last = np.maximum(starts - lengths, 0), np.minimum(starts + 2 * lengths, len(times)) - 1
    late = np.abs((times[last] - times[first]) / (step * (last - first)) - 1) < 1 / 6
    return [(int(s), int(n)) for s, n in zip(starts[~late], lengths[~late], strict=True)]


def _patterns(runs: RowRuns, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether in each of some rows all axes have the same number, whose size is not that of gravity."""
    readings = runs.rows_at(rows)[:, :3]
    numbers = readings / runs.scale + runs.offset
    size = np.linalg.norm(readings, axis=1)
    equal = np.ptp(numbers, axis=1) <= 1e-9 * np.abs(numbers).max(1)
    return np.asarray(equal & (np.abs(size - runs.size) > _NO_GRAVITY * runs.size))


def in_order(runs: RowRuns) -> Repair | None:
    """The rows in the order of their clock."""
    if not runs.backward:
        return None
    order = order_by_clock(runs.times())
    return None if order is None else Repair(order.rows, tuple(_order_records(order)))


def _order_records(order: RowOrder) -> Iterator[DamageRecord]:
    if len(order.moved):
        count, first = len(order.moved), int(order.moved.min()) + 1
        by = f"by up to {order.largest_s:.4g} s"
        finding = f"{counted(count, 'row')} not in the order of the clock, {by}, first row {first}"
        yield DamageRecord("disorder", finding, "sorted", "sorted", count, first, order.largest_s, "s")
    for kind, rows, why in (
        ("disorder", order.unplaced, "whose time has no place among the others"),
        ("duplicates", order.repeated, "whose time occurs already"),
    ):
        if len(rows):
            finding = f"{counted(len(rows), 'row')} {why}, first row {int(rows.min()) + 1}"
            yield DamageRecord(kind, finding, "left out", "left out", len(rows), int(rows.min()) + 1)


def one_of_each(runs: RowRuns) -> Repair | None:
    """One row of each sample, if the logger repeats them."""
    rate_hz = runs.rate_hz
    starts, lengths = runs_of(runs.same_force)
    # The first and the last run may be cut.
    ratio = rows_per_sample(lengths[1:-1])
    if ratio is None:
        return None
    samples = np.maximum(np.round(lengths / ratio), 1).astype(int)
    _, within = stretches_of(starts, samples)
    rows = np.repeat(starts, samples) + within * np.repeat(lengths, samples) // np.repeat(samples, samples)
    rates = (
        f": the sensor gives {rate_hz / ratio:.4g} samples a second, the file has {rate_hz:.4g} rows" if rate_hz else ""
    )
    finding, done = f"each sample is written {ratio:.3g} times{rates}", "one row of each is retained"
    record = DamageRecord("repeats", finding, done, "left out", len(runs) - len(rows), None, ratio, "rows a sample")
    return Repair(rows, (record,), len(rows) / len(runs))


def without_duplicates(runs: RowRuns) -> Repair | None:
    """The rows without consecutive duplicates."""
    twice = np.flatnonzero(runs.same & runs.same_time)
    if len(twice) < _EQUAL * np.count_nonzero(runs.same_time) or not len(twice):
        return None
    others = ~runs.same_time[1:]
    if not others.any() or np.mean(runs.same[1:][others]) > _ALIKE:
        return None
    first = int(twice[0]) + 1
    finding = f"{counted(len(twice), 'row')} occur twice, with the same time and readings, first row {first}"
    record = DamageRecord("duplicates", finding, "left out", "left out", len(twice), first)
    return Repair(np.flatnonzero(~(runs.same & runs.same_time)), (record,))


def rows_per_sample(lengths: NDArray[np.int64]) -> float | None:
    """Rows for each sample, from the lengths of runs of equal readings; None if readings do not repeat regularly."""
    count = len(lengths)
    if count < _FEWEST_CHANGES:
        return None
    mean, found = float(lengths.mean()), 1
    for least in range(2, _MOST_REPEATS + 1):
        expected = count * (1 - (1 - 1 / mean) ** (least - 1))
        sooner = np.count_nonzero(lengths < least)
        if expected >= _FEWEST_EXPECTED and sooner <= _SELDOM * expected:
            found = least
        elif sooner > count / 2:
            break
    if found == 1:
        return None
    single = lengths[(lengths >= found) & (lengths <= max(1.5 * found, found + 1))]
    multiples = np.mean(lengths % found == 0)
    if len(single) < count / 2 and (multiples < 0.95 or count < 100):
        return None
    return float(found if multiples >= 0.95 else single.mean())


def repaired_frames(path: Path, rows: NDArray[np.int64], begin_s: float = 0.0) -> Iterator[pl.DataFrame]:
    """These rows of a table, in this order and in pieces, with times from `begin_s` on."""
    table, count, _ = scan_parquet(path, check=False)
    rising = bool((np.diff(rows) > 0).all())
    whole = None if rising else table.collect()
    for first in range(0, count, PARQUET_ROWS):
        if whole is None:
            start, stop = np.searchsorted(rows, [first, first + PARQUET_ROWS])
            piece = table.slice(first, PARQUET_ROWS).collect()[rows[start:stop] - first]
        else:
            piece = whole[rows[first : first + PARQUET_ROWS]]
        yield piece.with_columns(pl.col(TIME) - begin_s) if TIME in piece.columns else piece
