"""The rows of a recording as columns in SI units, in pieces, and the rows that are left out."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.data.cells import LARGEST_NUMBER
from tumblecal.data.column_names import FORCE, LABELS, NUMBERS, QUANTITIES, RATE
from tumblecal.data.parquet import pieces_in_order, scan_parquet
from tumblecal.data.text_layout import ROW
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError
from tumblecal.ground.formula_cells import column_from_text
from tumblecal.ground.plain_text import CONTROLS
from tumblecal.ground.text_file import shown
from tumblecal.recordings.columns import Layout
from tumblecal.recordings.damage import DamageRecord
from tumblecal.recordings.table import Table


# Whether a row has a complete reading; the columns of the source.
WHOLE, SOURCE_COLUMNS = "\x00whole", "\x00source"
# With a larger share of unreadable rows, the layout is wrong instead of single lines.
_MOST_UNREADABLE, _SHOWN = 0.2, 5
# Fewest rows with equal readings that are erased memory; most rows that are late, before the clock goes on.
_FEWEST_ERASED, _MOST_LATE = 20, 100
# Readings of this many times the size of gravity are no readings.
_IMPOSSIBLE = 1000
# Share of equal readings among rows with one time that occur twice.
_ALIKE = 0.7
# Repeated samples: fewest runs of equal readings, and largest share of single ones.
_FEWEST_RUNS, _MOST_SINGLE = 50, 0.02


@dataclass
class Unread:
    """Rows without a complete reading: their number, the places of the first, and why the first cannot be read."""

    rows: int = 0
    places: list[int] = field(default_factory=list)
    why: str = ""


def names_of(layout: Layout) -> dict[str, str]:
    """Columns of the samples by quantity: `time_s, ax_g .., gx_dps .., temperature_degc, position ..`."""
    units = {role: f"{role}_{column.unit}" for role, column in layout.columns.items() if role in (*FORCE, *RATE)}
    names = {"time": "time_s", "temperature": "temperature_degc"} | units
    order = ("time", *(role for role in QUANTITIES if role != "time"))
    return {role: names.get(role, role) for role in order if role in layout.columns}


def sample_frames(
    table: Table, layout: Layout, path: str, unread: Unread, begin: list[float], more: Sequence[str] = ()
) -> Iterator[pl.DataFrame]:
    """All rows in pieces, with the columns of `names_of`, `WHOLE`, `ROW` and, for `more`, `SOURCE_COLUMNS`.

    **Arguments:**

    - `unread`: counts rows without a complete reading. `begin`: gets the first time, s, which becomes zero.
    - `more`: columns of the source to retain as text or numbers.

    **Raises:** `InputError` if there are no rows, or many cannot be read.
    """
    named = names_of(layout)
    wanted = [name for column in layout.columns.values() for name in (column.name, column.whole) if name]
    needed = [named[role] for role in (*FORCE, *RATE, "time", *NUMBERS) if role in named]
    seen = 0
    for piece in table.pieces(list(dict.fromkeys([*wanted, *more]))):
        frame = piece.select(
            (_label(layout.columns[role].name) if role in LABELS else layout.columns[role].reading(table)).alias(name)
            for role, name in named.items()
        )
        if "time_s" in frame.columns and len(frame):
            if not begin:
                begin += frame["time_s"].filter(frame["time_s"].abs() < LARGEST_NUMBER).drop_nans().head(1).to_list()
            frame = frame.with_columns(pl.col("time_s") - (begin[0] if begin else np.nan))
        # Numbers too large for any quantity are damage, and would overflow the sums of squares.
        usual = [
            pl.col(name).abs().fill_nan(np.inf) < (LARGEST_NUMBER if name != "time_s" else np.inf) for name in needed
        ]
        whole = frame.select(pl.all_horizontal(usual).fill_null(value=False)).to_series()
        places = piece[ROW] if ROW in piece.columns else pl.Series(np.arange(seen + 1, seen + len(piece) + 1))
        if not whole.all():
            rows = np.flatnonzero(~whole.to_numpy())
            unread.why = unread.why or _why(table, layout, piece, frame, int(rows[0]))
            unread.places += places.gather(rows[: _SHOWN - len(unread.places)]).to_list()
            unread.rows += len(rows)
        seen += len(piece)
        if unread.rows > max(_SHOWN, _MOST_UNREADABLE * seen) and not _blank(frame, named, whole):
            raise InputError(
                f"{path}:{table.row_word} {unread.places[0]}: {unread.rows} of {seen} rows cannot be read as "
                f"{', '.join(wanted)}; the first {unread.why}. Give the columns of the quantities by --columns"
            )
        source = [piece.select(more).to_struct(SOURCE_COLUMNS)] if more else []
        yield frame.with_columns(whole.alias(WHOLE), places.alias(ROW), *source)
    if not seen or unread.rows == seen:
        raise InputError(
            f"{path}: no rows" + (f" with a complete reading; the first {unread.why}" if unread.rows else "")
        )


def _label(name: str) -> pl.Expr:
    return column_from_text(pl.col(name).cast(pl.String).str.replace_all(CONTROLS, "?"))


def _blank(frame: pl.DataFrame, named: dict[str, str], whole: pl.Series) -> bool:
    """Whether rows without a reading have no number at all, as those of erased memory."""
    force = frame.filter(~whole).select(named[role] for role in FORCE)
    empty = pl.all_horizontal(pl.all().is_nan()) | pl.all_horizontal(pl.all().abs() >= LARGEST_NUMBER)
    return bool((force.select(empty.mean()).item() or 0.0) > 1 - _MOST_UNREADABLE)


def _why(table: Table, layout: Layout, piece: pl.DataFrame, frame: pl.DataFrame, row: int) -> str:
    """The cell of a row that is no number, in words."""
    for role, name in names_of(layout).items():
        value = frame[name][row] if role not in LABELS else 0.0
        if value is None or not abs(value) < LARGEST_NUMBER:
            cell = piece[layout.columns[role].name][row]
            return f"for column {layout.columns[role].name}" + ("" if cell is None else f", {shown(str(cell))}")
    return "for its cells"


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
        if same_time.any() and np.mean(same[same_time]) > _ALIKE and np.mean(same[~same_time]) < 1 - _ALIKE:
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


def retained_frames(samples: Path, kept: NDArray[np.bool_]) -> Iterator[pl.DataFrame]:
    """The rows of a table of samples that are retained, in pieces; the first time becomes zero."""
    first, begin = 0, None
    for piece in pieces_in_order(scan_parquet(samples, check=False)[0]):
        piece, first = piece.filter(kept[first : first + len(piece)]), first + len(piece)
        if "time_s" in piece.columns and len(piece):
            begin = piece["time_s"][0] if begin is None else begin
            piece = piece.with_columns(pl.col("time_s") - begin)
        yield piece
