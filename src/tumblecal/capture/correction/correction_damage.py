"""Damage of readings before correction, found by the rules by which `reduce` repairs recordings.

Rows of erased memory have no reading and are left out. Rows out of order, and rows that repeat a sample, have a reading: they
are reported and not changed.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.capture.columns.number_range import Wrap
from tumblecal.capture.columns.units import Column
from tumblecal.capture.decoding.sample_table import write_frames
from tumblecal.capture.recordings.damage import Damage
from tumblecal.capture.rows.contents import Contents
from tumblecal.capture.rows.row_repair import erased_record, repaired_frames, repairs
from tumblecal.capture.rows.row_runs import TIME, RowRuns, row_runs
from tumblecal.capture.rows.sample_file import RangeCheck
from tumblecal.capture.rows.sample_frames import WHOLE, blank_rows
from tumblecal.data.cells import LARGEST_NUMBER
from tumblecal.data.raw import Raw
from tumblecal.data.text_layout import ROW
from tumblecal.ground.atomic import scratch_folder


_RATE = re.compile("g[xyz]_(dps|rads|counts|raw)")
_MOST_RANGES = 200


@dataclass(frozen=True)
class RowDamage:
    """Damage of the rows of a source.

    **Arguments:**

    - `erased` (rows,): mask of rows without a reading. `damage`: its records. `all_usable`: whether all rows have a reading.
    - `wraps`: corrections of numbers outside the range of their type, if only later rows show it.
    """

    erased: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))
    damage: Damage = field(default_factory=Damage)
    all_usable: bool = True
    wraps: Mapping[str, Wrap] = field(default_factory=dict)

    def marked(self, frames: Iterator[pl.DataFrame]) -> Iterator[pl.DataFrame]:
        """Frames of all rows; if rows are erased, `WHOLE` marks the others, and `ROW` is the place of each in the source."""
        first = 0
        for frame in frames:
            erased, numbers = self.erased[first : first + len(frame)], np.arange(first, first + len(frame)) + 1
            first += len(frame)
            if erased.any():
                whole = frame[WHOLE] if WHOLE in frame.columns else pl.repeat(True, len(frame), eager=True)
                places = frame[ROW] if ROW in frame.columns else pl.Series(numbers)
                frame = frame.with_columns((whole & pl.Series(~erased)).alias(WHOLE), places.alias(ROW))
            yield frame


def row_damage(
    header: Raw, frames: Iterator[pl.DataFrame], columns: Sequence[Column], contents: Contents | None = None
) -> RowDamage:
    """The damage of the rows of a source.

    **Arguments:**

    - `header`: its columns and comments. `frames`: all its rows; rows that are not `WHOLE` are skipped.
    - `columns`: the accelerations in the source. `contents`: counts the frames of a recording; None for a table in known
      units, whose numbers have no type.
    """
    look = RangeCheck(columns if contents else ())
    with scratch_folder(header.path) as folder:
        rows, rest = folder / "rows.parquet", folder / "rest.parquet"
        if contents is None and (count := _sound_rows(header)):
            rows, schema, usable, erased = header.path, _schema(header), np.ones(count, bool), np.zeros(count, bool)
        else:
            schema, usable, erased = _write_numbers(rows, header, frames)

        def runs_of(path: Path) -> RowRuns:
            channels = [name for name in schema if name != TIME]
            rate_hz = contents and contents.rate_hz
            return row_runs(path, channels, timed=TIME in schema, columns=columns, rate_hz=rate_hz, look=look)

        if not usable.any():
            return RowDamage()
        runs, damage = runs_of(rows), Damage()
        if look.wraps:
            return RowDamage(wraps=look.wraps)
        if erased.any():
            damage.add(erased_record(int(erased.sum()), int(erased.argmax()) + 1, "no axis has a number"))
        erased_in, *others = repairs()
        if repair := erased_in(runs):
            erased[np.delete(np.flatnonzero(usable), repair.rows)] = True
            damage.records += repair.records
            write_frames(rest, repaired_frames(rows, repair.rows), schema)
            runs = runs_of(rest)
        for repair in filter(None, (find(runs) for find in others)):
            damage.records += [record.unrepaired() for record in repair.records]
    return RowDamage(erased, damage, bool(usable.all()) and not erased.any())


def _schema(header: Raw) -> pl.Schema:
    """The columns that show damage: accelerations, rates, times."""
    rates = [name for name in header.frame.columns if _RATE.fullmatch(name)]
    times = [TIME] if TIME in header.frame.columns else []
    return pl.Schema(dict.fromkeys([*header.columns, *rates, *times], pl.Float64))


def _sound_rows(header: Raw) -> int:
    """The number of rows of a Parquet file whose readings are all numbers and need not be written again; 0 for others."""
    if header.path.suffix != ".parquet" or not all(header.frame[name].dtype.is_numeric() for name in _schema(header)):
        return 0
    usable = pl.all_horizontal(pl.col(header.columns).abs() < LARGEST_NUMBER).all().alias("usable")
    table = pl.scan_parquet(header.path, glob=False).select(usable, pl.len().alias("count"))
    sound, count = table.collect(engine="streaming").row(0)
    return count if sound else 0


def _write_numbers(
    path: Path, header: Raw, frames: Iterator[pl.DataFrame]
) -> tuple[pl.Schema, NDArray[np.bool_], NDArray[np.bool_]]:
    """Write the readings and times of the usable rows as Parquet; return the columns, the mask of these rows, and the mask of
    rows without any number."""
    schema = _schema(header)
    usable, blank = [np.zeros(0, bool)], [np.zeros(0, bool)]

    def numbers() -> Iterator[pl.DataFrame]:
        for frame in frames:
            table = frame.select(header.cast(frame[name]).alias(name) for name in schema)
            force = table.select(header.columns)
            whole = frame[WHOLE].to_numpy() if WHOLE in frame.columns else np.ones(len(frame), bool)
            usual = force.select(pl.all_horizontal(pl.all().abs() < LARGEST_NUMBER).fill_null(value=False)).to_series()
            usable.append(usual.to_numpy() & whole)
            # The reader of a recording counts rows without a number.
            blank.append(whole & blank_rows(force) if not usual.all() else np.zeros(len(frame), bool))
            yield table.filter(pl.Series(usable[-1]))

    write_frames(path, numbers(), schema)
    return schema, np.concatenate(usable), np.concatenate(blank)


def left_out_words(row_word: str, frames: Iterator[pl.DataFrame]) -> str:
    """The rows of a source that are not `WHOLE`, such as `lines 52 to 71, 300`; empty for none."""
    parts = [np.zeros(0, int)]
    for frame in frames:
        if WHOLE in frame.columns:
            parts.append(frame[ROW].to_numpy()[~frame[WHOLE].to_numpy()])
    places = np.concatenate(parts)
    spans = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1) if len(places) else []
    words = [f"{span[0]} to {span[-1]}" if len(span) > 1 else f"{span[0]}" for span in spans[:_MOST_RANGES]]
    more = [f"and {sum(map(len, spans[_MOST_RANGES:]))} more"] if len(spans) > _MOST_RANGES else []
    return f"{row_word}{'s' if len(places) > 1 else ''} {', '.join([*words, *more])}" if words else ""
