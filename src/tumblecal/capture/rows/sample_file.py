"""Conversion of a recording of any format to one table of samples, a Parquet file: streamed, with constant memory.

Columns: `time_s`; `ax_g`, `ax_ms2` (m/s^2), `ax_mg` or `ax_counts`; `gx_dps`, `gx_rads`, `gx_counts` or, in an unknown unit,
`gx_raw`; `temperature_degc`; `position`, `run`, `mount`, `alpha_deg`, `beta_deg`, `approach`.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from shutil import copyfile
from types import MappingProxyType

import numpy as np
import polars as pl

from tumblecal.capture.columns.column_names import LABELS
from tumblecal.capture.columns.number_range import Wrap, wraps_of_force
from tumblecal.capture.columns.roles import ColumnLayout, has_force, layout_of
from tumblecal.capture.columns.units import FORCE, RATE, Column
from tumblecal.capture.decoding.sample_table import write_frames
from tumblecal.capture.recordings import source_tables
from tumblecal.capture.recordings.already_corrected import already_corrected
from tumblecal.capture.recordings.damage import Damage
from tumblecal.capture.recordings.guesses import guessed
from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.capture.recordings.table import SourceTable
from tumblecal.capture.rows.contents import RATE_KEYS, Contents
from tumblecal.capture.rows.row_repair import repaired_frames, repairs
from tumblecal.capture.rows.row_runs import RowRuns, row_runs
from tumblecal.capture.rows.sample_frames import WHOLE, frames_of, quantity_names
from tumblecal.data.parquet import pieces_in_order, scan_parquet
from tumblecal.data.text_layout import ROW
from tumblecal.ground.atomic import scratch_folder, written_aside
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import comments_of, gravity_of_option


@dataclass(frozen=True)
class SampleStream:
    """The table of a recording's samples, in pieces; `contents` counts the rows as they are read.

    `frames_with(names)` gives the frames of all rows, with the columns `WHOLE`, `ROW` and, for these columns of the
    source, `SOURCE_COLUMNS`.
    """

    contents: Contents
    frames: Iterator[pl.DataFrame]
    schema: pl.Schema
    comments: dict[str, str]
    frames_with: Callable[[Sequence[str]], Iterator[pl.DataFrame]]


def sample_stream(
    path: Path,
    options: RecordingOptions,
    *,
    by: str = "",
    in_force_units: bool = False,
    needed: Collection[str] | None = None,
    wraps: Mapping[str, Wrap] = MappingProxyType({}),
) -> SampleStream:
    """The samples of a recording, row by row and unchanged; `write_samples` repairs damaged rows.

    **Arguments:**

    - `by`: column that becomes `position`. `in_force_units`: convert counts to g, and reject counts of unknown scale.
    - `needed`: quantities needed from a table that retains its columns; its other columns may have any content.
    - `wraps`: corrections of numbers outside the range of their type, by quantity; found in the first rows if empty.

    **Raises:** `InputError` for a recording that cannot be read, or has no accelerations.
    """
    if options.rate is not None and not 0 < options.rate < 1e7:
        raise InputError(f"--rate {options.rate:g}: not a sample rate; give samples a second, above 0 and below 1e7")
    options = replace(options, columns=",".join(filter(None, [options.columns, by and f"position={by}"])))
    damage = Damage()
    reader, tables = source_tables(path, options, damage)
    table = _chosen(path, tables, options)
    for record in already_corrected(table.comments):
        damage.add(record)
    layout = layout_of(table, options, str(path), needed if table.sheet else None, wraps)
    if in_force_units:
        with guessed(layout.guesses):
            layout = _in_force_units(layout, path)
    if needed is not None and table.sheet and table.as_written is not None:
        numbers = {name for column in layout.columns.values() for name in column.names}
        layout = replace(layout, table=table.as_written(numbers))
    contents = Contents(reader, tables, layout, options, damage)
    schema = pl.Schema({name: pl.String if name in LABELS else pl.Float64 for name in quantity_names(layout).values()})
    return SampleStream(
        contents,
        _whole_rows(frames_of(layout, contents, str(path), ())),
        schema,
        _comments(contents, path),
        lambda names: frames_of(layout, contents, str(path), names),
    )


def write_samples(
    path: Path, out: Path, options: RecordingOptions, *, by: str = "", in_force_units: bool = False, means: bool = False
) -> Contents:
    """Write the samples of a recording as one table, with damaged rows repaired; the name of `out` selects Parquet or CSV.

    **Arguments, raises:** as `sample_stream`; `means`: rows are means instead of samples and are not repaired.
    """
    with scratch_folder(path) as folder:
        rows = folder / "rows.parquet"

        def written(wraps: Mapping[str, Wrap]) -> SampleStream:
            samples = sample_stream(path, options, by=by, in_force_units=in_force_units, wraps=wraps)
            with guessed(samples.contents.layout.guesses):
                write_frames(rows, samples.frames, samples.schema, samples.comments)
            return samples

        samples = written({})
        contents = samples.contents
        if not means:
            look = RangeCheck([contents.layout.columns[role] for role in FORCE])
            runs = runs_of_samples(rows, contents, look)
            if look.wraps:
                samples = written(look.wraps)
                contents = samples.contents
                runs = runs_of_samples(rows, contents)
            contents = _repaired(rows, runs, contents, path, samples.schema)
        if out.suffix == ".parquet":
            with written_aside(out) as aside:
                copyfile(rows, aside)
        else:
            table, _, comments = scan_parquet(rows, check=False)
            write_frames(out, pieces_in_order(table), samples.schema, comments)
    return contents


class RangeCheck:
    """Checks all rows for numbers of these acceleration columns outside the range of their type, if the first rows do not show
    them."""

    def __init__(self, columns: Sequence[Column]):
        self.columns = columns
        self.wraps: dict[str, Wrap] = {}

    def __call__(self, force: np.ndarray) -> None:
        """Check the accelerations of a piece."""
        if not self.columns or self.wraps or any(column.wrap for column in self.columns):
            return
        scale = np.array([column.scale for column in self.columns])
        # As in the source: a reading is scale (number - offset).
        numbers = np.round(force / scale + [column.offset for column in self.columns], 9)
        found = wraps_of_force(numbers, scale)
        self.wraps = {role: wrap for role, wrap in zip(FORCE, found or [], strict=False) if wrap}


def runs_of_samples(rows: Path, contents: Contents, look: Callable[[np.ndarray], None] = lambda force: None) -> RowRuns:
    """The runs of equal rows of a table of samples; `look` is called with the accelerations of each piece."""
    named = quantity_names(contents.layout)
    channels = [named[role] for role in (*FORCE, *RATE) if role in named]
    columns = [contents.layout.columns[role] for role in FORCE]
    return row_runs(rows, channels, timed="time" in named, columns=columns, rate_hz=contents.rate_hz, look=look)


def _repaired(rows: Path, runs: RowRuns, contents: Contents, path: Path, schema: pl.Schema) -> Contents:
    """Repair each kind of damage in the table `rows`, and return its contents."""
    for find in repairs():
        repair = find(runs)
        if repair is None:
            continue
        contents = contents.uncounted()
        contents.samples_per_row *= repair.samples_per_row
        for record in repair.records:
            contents.damage.add(record)
        begin_s = float(runs.rows_at(repair.rows[:1])[0, -1]) if runs.timed else 0.0
        frames = _counted(repaired_frames(rows, repair.rows, begin_s), contents)
        write_frames(rows, frames, schema, _comments(contents, path))
        contents.begin_s += begin_s
        runs = runs_of_samples(rows, contents)
    return contents


def _counted(frames: Iterator[pl.DataFrame], contents: Contents) -> Iterator[pl.DataFrame]:
    for frame in frames:
        contents.add(frame)
        yield frame


def _chosen(path: Path, tables: list[SourceTable], options: RecordingOptions) -> SourceTable:
    """The table with the samples: by option, or the one with accelerations and most rows; tables with rates come first."""
    if options.topic:
        named = [table for table in tables if table.name == options.topic]
        if named:
            return named[0]
    with_force = [table for table in tables if has_force(table, options)] if not options.topic else []
    if not with_force and len(tables) == 1 and not options.topic and tables[0].columns:
        return tables[0]
    if not with_force:
        if options.topic and len(tables) == 1 and not tables[0].name:
            raise InputError(
                f"{path}: no topic {options.topic}: the file has one table, without a name; remove --topic"
            )
        there = (
            ", ".join(f"{table.name} ({table.description or f'{table.rows} rows'})" for table in tables) or "nothing"
        )
        raise InputError(
            f"{path}: no {f'topic {options.topic}' if options.topic else 'accelerations'}; the file has {there}"
        )
    return max(with_force, key=lambda table: (any("gx" in role for role in table.roles.values()), table.rows or 0))


def _in_force_units(layout: ColumnLayout, path: Path) -> ColumnLayout:
    if layout.unit != "counts":
        return layout
    if layout.per_g is None:
        raise InputError(
            f"{path}: the readings' size is about {layout.size:.5g}: neither g, mg, m/s^2 nor usual counts; give the unit "
            f"(--unit g, --unit 16384/g) and, if needed, --scale and --offset"
        )
    in_g = {
        role: replace(layout.columns[role], unit="g", scale=layout.columns[role].scale / layout.per_g) for role in FORCE
    }
    return replace(layout, columns=dict(layout.columns) | in_g)


def _comments(contents: Contents, path: Path) -> dict[str, str]:
    comments = {key: value for key, value in contents.layout.table.comments.items() if key not in RATE_KEYS}
    if contents.layout.per_g:
        comments["counts_per_g"] = f"{contents.layout.per_g:g}"
    if contents.rate_hz and "time" not in contents.layout.columns:
        comments["rate_hz"] = f"{contents.rate_hz:g}"
    gravity = comments_of(gravity_of_option(contents.options.gravity)) if contents.options.gravity else {}
    return comments | gravity | {"imported_from": path.name}


def _whole_rows(frames: Iterator[pl.DataFrame]) -> Iterator[pl.DataFrame]:
    return (frame.filter(WHOLE).drop(WHOLE, ROW) for frame in frames)
