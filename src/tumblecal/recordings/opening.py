"""Which table and which rows of a source are the recording, and its columns, from the first rows."""

import re
import shlex
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import polars as pl

from tumblecal.data.column_names import FORCE, parsed
from tumblecal.ground.errors import InputError
from tumblecal.ground.option_texts import pairs
from tumblecal.recordings.columns import given_columns
from tumblecal.recordings.damage import Damage
from tumblecal.recordings.description import described
from tumblecal.recordings.formats import tables_of
from tumblecal.recordings.formats.already_corrected import already_corrected
from tumblecal.recordings.guesses import guessed, question
from tumblecal.recordings.layout import layout_of
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.table import Table


_SENSOR_WORD = re.compile("sensor|id|device|imu|node|channel|unit|address|addr|mac|tag|name|source|kind|type")
_MOST_SENSORS, _MOST_IN_TURN = 16, 100


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
    table = _chosen(path, tables, options)
    table = _of_sensor(path, table, options) if options.rows else table
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
            if layout.per_g is None:
                words = f"the readings' size is about {layout.size:.5g}: neither g, mg, m/s^2 nor usual counts; give the unit"
                raise question(path, words, ["--unit g", "--unit 16384/g, and --scale or --offset if needed"])
            axes = {axis: layout.columns[axis] for axis in FORCE}
            axes = {axis: replace(one, unit="g", scale=one.scale / layout.per_g) for axis, one in axes.items()}
            layout = replace(layout, columns={**layout.columns, **axes})
    return Recording(path, reader, tables, table, options, layout, damage)


def _chosen(path: Path, tables: Sequence[Table], options: RecordingOptions) -> Table:
    """The table with the samples: by option, or the one with accelerations and most rows; tables with rates come first.

    **Raises:** `InputError` with the options that select a table, if none states accelerations.
    """
    if len(tables) == 1 and tables[0].columns and not options.topic:
        return tables[0]
    wanted = [
        table for table in tables if options.topic == table.name or (not options.topic and _has_force(table, options))
    ]
    if not wanted:
        found = [f"{one.name or 'a table without a name'} ({one.words or f'{one.rows} rows'})" for one in tables]
        missing = f"topic {options.topic}" if options.topic else "accelerations"
        choices = [f"--topic {shlex.quote(table.name)}" for table in tables if table.name and len(table.columns) > 2]
        words = f"no {missing}; the file has {', '.join(found) or 'nothing'}{'; choose one' if choices else ''}"
        raise question(path, words, choices)
    return max(wanted, key=lambda table: (any("gx" in role for role in table.roles.values()), table.rows or 0))


def _has_force(table: Table, options: RecordingOptions) -> bool:
    """Whether a table has accelerations by option, by its format or by name."""
    stated = {role.partition("_")[0] for role in table.roles.values()}
    given = {*pairs("--columns", options.columns, "ax=AccX,ay=AccY,az=AccZ")} if len(table.columns) > 2 else set[str]()
    names = [parsed(column) for column in table.columns]
    axes = {name.axis for name in names if name.quantity == "acceleration" and name.axis}
    return {*FORCE} <= stated or {*FORCE} <= given or len(axes) > 2


def _of_sensor(path: Path, table: Table, options: RecordingOptions) -> Table:
    """The rows of one sensor of a table, by the option `--rows`."""
    name, value = next(iter(pairs("--rows", options.rows, "sensor=1").items()))
    if name not in table.columns:
        raise InputError(f"{path}: --rows {options.rows}: no such column; the table has {', '.join(table.columns)}")
    text = pl.col(name).cast(pl.String).str.strip_chars()
    number = pl.col(name).cast(pl.Float64, strict=False) == pl.lit(value).cast(pl.Float64, strict=False)

    def pieces(columns: Sequence[str]) -> Iterator[pl.DataFrame]:
        for piece in table.pieces(list(dict.fromkeys([*columns, name]))):
            yield piece.filter((text == value) | number.fill_null(value=False)).drop([] if name in columns else name)

    return replace(table, pieces=pieces, rows=None)


def _ask_for_sensor(table: Table, first: pl.DataFrame, path: Path, options: RecordingOptions) -> None:
    """Raise if rows of several sensors alternate in a table.

    **Raises:** `InputError` with the options that select one.
    """
    used = {column.name for column in given_columns(table, options).values()}
    for name in table.columns:
        meaning = parsed(name)
        if name in used or meaning.quantity not in ("", "other") or not any(map(_SENSOR_WORD.fullmatch, meaning.stem)):
            continue
        cells = first[name].cast(pl.String).drop_nulls()
        values = cells.unique(maintain_order=True)
        # Sensors alternate; a label of what the sensor does changes rarely.
        rarely = max(2 * len(values), len(cells) / _MOST_IN_TURN)
        if 2 <= len(values) <= _MOST_SENSORS and (cells != cells.shift(1)).sum() > rarely:
            words = f"column {name} has {len(values)} values in turn: rows of several sensors; select one"
            raise question(path, words, [f"--rows {shlex.quote(f'{name}={value}')}" for value in values])
