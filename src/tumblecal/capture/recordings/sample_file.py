"""From a recording of any format to the one table of samples, a Parquet file: streamed, in memory that does not grow.

Columns: `time_s`; `ax_g`, `ax_ms2` (m/s^2), `ax_mg` or `ax_counts`; `gx_dps`, `gx_rads`, `gx_counts` or, in a unit that nobody
knows, `gx_raw`; `temperature_degc`; `position`, `run`, `mount`, `alpha_deg`, `beta_deg`, `approach`.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tumblecal.capture.recordings import source_tables
from tumblecal.capture.recordings.clock_text import FORMS, seconds_of
from tumblecal.capture.recordings.column_names import LABELS, NUMBERS
from tumblecal.capture.recordings.contents import RATE_KEYS, Contents
from tumblecal.capture.recordings.damage import Damage
from tumblecal.capture.recordings.guesses import guessed
from tumblecal.capture.recordings.options import Asked
from tumblecal.capture.recordings.roles import Layout, has_force, layout_of
from tumblecal.capture.recordings.table import SourceTable
from tumblecal.capture.recordings.units import FORCE, RATE, Column
from tumblecal.capture.sample_table import write_frames
from tumblecal.data.cells import LARGEST_NUMBER
from tumblecal.data.text_layout import ROW
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import comments_of, gravity_of_option
from tumblecal.ground.plain_text import CONTROLS
from tumblecal.ground.text_file import shown


if TYPE_CHECKING:
    import polars as pl

# Columns of the frames of a table that is kept: its own columns as a struct, and whether a row holds a whole reading.
OWN, WHOLE = "\x00own", "\x00whole"
# Beyond this share of rows that cannot be read, the layout is wrong, not some lines.
_MOST_UNREADABLE = 0.2
_SHOWN = 5
_DAY_S = 86400


@dataclass(frozen=True)
class SampleStream:
    """The one table of a recording's samples, a piece at a time; `contents` adds up what has been read.

    `frames_with(names)` are the frames of all rows, with the columns `WHOLE` and, of these columns of the source, `OWN`.
    """

    contents: Contents
    frames: Iterator["pl.DataFrame"]
    schema: "pl.Schema"
    comments: dict[str, str]
    frames_with: Callable[[Sequence[str]], Iterator["pl.DataFrame"]]


def sample_stream(
    path: Path, asked: Asked, *, by: str = "", in_force_units: bool = False, needed: Collection[str] | None = None
) -> SampleStream:
    """The samples of a recording.

    **Arguments:**

    - `by`: column that becomes `position`. `in_force_units`: counts become g; refuse those of which nobody knows how many.
    - `needed`: quantities that are wanted of a table whose columns are kept; what else is in it may be anything.

    **Raises:** `InputError` for a recording that cannot be read, or holds no accelerations.
    """
    import polars as pl

    if asked.rate is not None and not 0 < asked.rate < 1e7:
        raise InputError(f"--rate {asked.rate:g}: samples a second, above 0")
    asked = replace(asked, columns=",".join(filter(None, [asked.columns, by and f"position={by}"])))
    damage = Damage()
    reader, tables = source_tables(path, asked, damage)
    table = _chosen(path, tables, asked)
    layout = layout_of(table, asked, str(path), needed if table.sheet else None)
    if in_force_units:
        with guessed(layout.said):
            layout = _in_force_units(layout, path)
    contents = Contents(reader, tables, layout, asked, damage)
    schema = pl.Schema({name: pl.String if name in LABELS else pl.Float64 for name in _named(layout).values()})
    return SampleStream(
        contents,
        _whole_rows(_frames(layout, contents, str(path), ())),
        schema,
        _comments(contents, path),
        lambda own: _frames(layout, contents, str(path), own),
    )


def write_samples(path: Path, out: Path, asked: Asked, *, by: str = "", in_force_units: bool = False) -> Contents:
    """Write the samples of a recording as the one table, Parquet or CSV by the name of `out`.

    **Arguments, raises:** as `sample_stream`.
    """
    samples = sample_stream(path, asked, by=by, in_force_units=in_force_units)
    with guessed(samples.contents.layout.said):
        write_frames(out, samples.frames, samples.schema, samples.comments)
    return samples.contents


def _chosen(path: Path, tables: list[SourceTable], asked: Asked) -> SourceTable:
    """The table with the samples: as asked, or that with accelerations and the most rows; with rates before without."""
    if asked.topic:
        named = [table for table in tables if table.name == asked.topic]
        if named:
            return named[0]
    with_force = [table for table in tables if has_force(table, asked)] if not asked.topic else []
    if not with_force and len(tables) == 1 and not asked.topic and tables[0].columns:
        return tables[0]
    if not with_force:
        if asked.topic and len(tables) == 1 and not tables[0].name:
            raise InputError(f"{path}: no topic {asked.topic}; it holds one table, without a name: leave out --topic")
        there = ", ".join(f"{table.name} ({table.said or f'{table.rows} rows'})" for table in tables) or "nothing"
        raise InputError(f"{path}: no {f'topic {asked.topic}' if asked.topic else 'accelerations'}; it holds {there}")
    return max(with_force, key=lambda table: (any("gx" in role for role in table.roles.values()), table.rows or 0))


def _in_force_units(layout: Layout, path: Path) -> Layout:
    if layout.unit != "counts":
        return layout
    if layout.per_g is None:
        raise InputError(
            f"{path}: the readings' size is about {layout.size:.5g}: neither g, mg, m/s^2 nor usual counts; say the unit "
            f"(--unit g, --unit 16384/g) and, where it must be, --scale and --offset"
        )
    in_g = {
        role: replace(layout.columns[role], unit="g", scale=layout.columns[role].scale / layout.per_g) for role in FORCE
    }
    return replace(layout, columns=dict(layout.columns) | in_g)


def _named(layout: Layout) -> dict[str, str]:
    """The columns' names in the one table, by quantity."""
    order = ("time", *FORCE, *RATE, "temperature", *NUMBERS, *LABELS)
    names = {"time": "time_s", "temperature": "temperature_degc"}
    units = {role: f"{role}_{column.unit}" for role, column in layout.columns.items() if role in (*FORCE, *RATE)}
    return {role: (names | units).get(role, role) for role in order if role in layout.columns}


def _comments(contents: Contents, path: Path) -> dict[str, str]:
    kept = {key: value for key, value in contents.layout.table.comments.items() if key not in RATE_KEYS}
    if contents.layout.per_g:
        kept["counts_per_g"] = f"{contents.layout.per_g:g}"
    if contents.rate_hz and "time" not in contents.layout.columns:
        kept["rate_hz"] = f"{contents.rate_hz:g}"
    gravity = comments_of(gravity_of_option(contents.asked.gravity)) if contents.asked.gravity else {}
    return kept | gravity | {"imported_from": path.name}


def _whole_rows(frames: Iterator["pl.DataFrame"]) -> Iterator["pl.DataFrame"]:
    return (frame.filter(WHOLE).drop(WHOLE) for frame in frames)


def _frames(layout: Layout, contents: Contents, path: str, own: Sequence[str]) -> Iterator["pl.DataFrame"]:
    """The rows, a piece at a time, as `SampleStream.frames_with`; rows without a whole reading are counted."""
    import polars as pl

    named = _named(layout)
    wanted = list(dict.fromkeys(layout.columns[role].name for role in named))
    needed = [named[role] for role in (*FORCE, *RATE, "time", *NUMBERS) if role in named]
    begin = np.nan
    seen = 0
    for piece in layout.table.pieces(list(dict.fromkeys([*wanted, *own]))):
        frame = piece.select(
            _expression(layout.columns[role]).alias(name) if role not in LABELS else
            pl.col(layout.columns[role].name).cast(pl.String).str.replace_all(CONTROLS, "?").alias(name)
            for role, name in named.items()
        )  # fmt: skip
        if "time_s" in frame.columns and len(frame):
            begin = next(iter(frame["time_s"].drop_nans().drop_nulls().head(1)), np.nan) if np.isnan(begin) else begin
            frame = frame.with_columns(pl.col("time_s") - begin)
            clock = layout.columns["time"]
            shown_s = begin + clock.offset * (_DAY_S if clock.unit in FORMS else clock.scale)
            contents.begin_s = shown_s + layout.table.zero_s()
        # Numbers that no quantity has are damage, and would overflow the sums of squares.
        usual = pl.col(needed).abs() < LARGEST_NUMBER
        whole = frame.select(pl.all_horizontal(usual.fill_null(False))).to_series()
        if not whole.all():
            rows = np.flatnonzero(~whole.to_numpy())
            contents.unreadable += len(rows)
            contents.first_unread = contents.first_unread or _unread_in(layout, piece, frame, int(rows[0]))
            places = piece[ROW].to_numpy() if ROW in piece.columns else np.arange(seen + 1, seen + len(piece) + 1)
            contents.places += (
                places[rows[: _SHOWN - len(contents.places)]].tolist() if len(contents.places) < _SHOWN else []
            )
        seen += len(piece)
        if contents.unreadable > max(_SHOWN, _MOST_UNREADABLE * seen):
            raise InputError(
                f"{path}:{layout.table.row_word} {contents.places[0]}: {contents.unreadable} of {seen} rows cannot be read "
                f"as {', '.join(wanted)}; the first {contents.first_unread}: another layout; give --columns"
            )
        contents.add(frame if whole.all() else frame.filter(whole))
        columns = [piece.select(own).to_struct(OWN)] if own else []
        yield frame.with_columns(whole.alias(WHOLE), *columns)
    if not contents.rows:
        raise InputError(f"{path}: no rows")


def _unread_in(layout: Layout, piece: "pl.DataFrame", frame: "pl.DataFrame", row: int) -> str:
    """Which cell of a row is no number; that cells are missing where its text is not kept."""
    for role, name in _named(layout).items():
        value = frame[name].cast(float).to_numpy()[row] if role in (*FORCE, *RATE, "time", *NUMBERS) else 0.0
        if not abs(value) < LARGEST_NUMBER:
            cell = piece[layout.columns[role].name][row]
            return f"for column {layout.columns[role].name}" + ("" if cell is None else f", {shown(cell)}")
    return "for its cells"


def _expression(column: Column) -> "pl.Expr":
    import polars as pl

    if column.unit in FORMS:
        return seconds_of(column.name, column.unit, column.offset)
    values = pl.col(column.name).cast(pl.Float64, strict=False)
    return (values - column.offset) * column.scale
