"""Which table and which rows of a source are the recording, and its columns, from the first rows."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl

from tumblecal.data.column_names import FORCE, parsed
from tumblecal.ground.errors import InputError
from tumblecal.recordings.columns import Layout, given_columns, pairs
from tumblecal.recordings.damage import Damage
from tumblecal.recordings.description import described
from tumblecal.recordings.formats import tables_of
from tumblecal.recordings.formats.already_corrected import already_corrected
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.layout import layout_of
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.table import Table


_SENSOR_WORDS = frozenset(
    [
        "sensor",
        "id",
        "device",
        "imu",
        "node",
        "channel",
        "unit",
        "address",
        "addr",
        "mac",
        "tag",
        "name",
        "source",
        "kind",
        "type",
    ]
)


_MOST_SENSORS = 16


def opened(
    path: Path, options: RecordingOptions, by: str = "", *, in_g: bool = False, only: Collection[str] | None = None
) -> Recording:
    """A recording with its columns, from its first rows; its rows are not read yet.

    **Arguments:**

    - `path`: the recording, or its description `FILE.recording.toml`, whose entries are defaults of the options.
    - `by`: column that becomes `position`. `in_g`: counts are converted to g, and rejected if their scale is unknown.
    - `only`: the quantities that are needed; other columns may have any content.

    **Raises:** `InputError` for a recording that cannot be read, or that does not state its columns and units.
    """
    path, options = described(path, options)
    if options.rate is not None and not 0 < options.rate < 1e7:
        raise InputError(f"--rate {options.rate:g}: not a sample rate; give samples a second, above 0 and below 1e7")
    options = replace(options, columns=",".join(filter(None, [options.columns, by and f"position={by}"])))
    damage = Damage()
    reader, tables = tables_of(path, options, damage)
    table = _selected(_chosen(path, tables, options), options, path)
    for record in already_corrected(table.stated):
        damage.add(record)
    first = next(iter(table.pieces(table.columns)), pl.DataFrame())
    if not len(first):
        raise InputError(f"{path}: no rows")
    if not options.rows:
        _ask_for_sensor(table, first, path, options)
    notes: list[str] = []
    with guessed(notes):
        layout = layout_of(table, first, options, str(path), notes, only if table.sheet else None)
        if in_g and layout.unit == "counts":
            layout = _in_g(layout, path)
    return Recording(path, reader, tables, table, options, layout, damage)


def _selected(table: Table, options: RecordingOptions, path: Path) -> Table:
    """The rows of one sensor of a table, by the option `--rows`."""
    if not options.rows:
        return table
    ((name, value),) = list(pairs(options.rows, "--rows").items())[:1]
    if name not in table.columns:
        raise InputError(f"{path}: --rows {options.rows}: no such column; the table has {', '.join(table.columns)}")

    def pieces(columns: Sequence[str]) -> Iterator[pl.DataFrame]:
        for piece in table.pieces(list(dict.fromkeys([*columns, name]))):
            text = pl.col(name).cast(pl.String).str.strip_chars()
            number = pl.col(name).cast(pl.Float64, strict=False) == (float(value) if _is_number(value) else None)
            yield piece.filter((text == value) | number.fill_null(value=False)).select(
                pl.exclude(name) if name not in columns else pl.all()
            )

    return replace(table, pieces=pieces, rows=None)


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False


def _ask_for_sensor(table: Table, first: pl.DataFrame, path: Path, options: RecordingOptions) -> None:
    """Raise if rows of several sensors alternate in a table.

    **Raises:** `InputError` with the options that select one.
    """
    used = {column.name for column in given_columns(table, options).values()}
    for name in table.columns:
        if name in used or not _SENSOR_WORDS & {*parsed(name).stem}:
            continue
        cells = first[name].cast(pl.String).drop_nulls()
        values = cells.unique(maintain_order=True).to_list() if len(cells) else []
        if 2 <= len(values) <= _MOST_SENSORS and (cells != cells.shift(1)).sum() > 2 * len(values):
            choices = " or ".join(f"--rows {name}={value}" for value in values)
            raise InputError(
                f"{path}: column {name} has {len(values)} values in turn: rows of several sensors; select one: {choices}"
            )


def _chosen(path: Path, tables: list[Table], options: RecordingOptions) -> Table:
    """The table with the samples: by option, or the one with accelerations and most rows; tables with rates come first."""
    there = ", ".join(f"{table.name} ({table.words or f'{table.rows} rows'})" for table in tables) or "nothing"
    if options.topic:
        if named := [table for table in tables if table.name == options.topic]:
            return named[0]
        if len(tables) == 1 and not tables[0].name:
            raise InputError(
                f"{path}: no topic {options.topic}: the file has one table, without a name; remove --topic"
            )
        raise InputError(f"{path}: no topic {options.topic}; the file has {there}")
    if len(tables) == 1 and tables[0].columns:
        return tables[0]
    with_force = [table for table in tables if _has_force(table, options)]
    if not with_force:
        raise InputError(f"{path}: no accelerations; the file has {there}")
    return max(with_force, key=lambda table: (any("gx" in role for role in table.roles.values()), table.rows or 0))


def _has_force(table: Table, options: RecordingOptions) -> bool:
    """Whether a table has accelerations by option, by its format or by name."""
    stated = {role for text in table.roles.values() if (role := text.partition("_")[0])}
    given = {*pairs(options.columns, "--columns")}
    named = {name.axis for column in table.columns if (name := parsed(column)).quantity == "acceleration"}
    return {*FORCE} <= stated or ({*FORCE} <= given and len(table.columns) > 2) or len(named - {""}) >= 3


def _in_g(layout: Layout, path: Path) -> Layout:
    if layout.per_g is None:
        raise InputError(
            f"{path}: the readings' size is about {layout.size:.5g}: neither g, mg, m/s^2 nor usual counts; give the unit "
            f"(--unit g, --unit 16384/g) and, if needed, --scale and --offset"
        )
    changed = {
        role: replace(layout.columns[role], unit="g", scale=layout.columns[role].scale / layout.per_g) for role in FORCE
    }
    return replace(layout, columns={**layout.columns, **changed})
