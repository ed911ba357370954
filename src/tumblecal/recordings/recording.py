"""A recording of any format as one table of samples in SI units, and what the file states about it."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.capture.decoding.sample_table import write_frames
from tumblecal.data.joined_clocks import TIME_BEGAN, TIME_ZERO, moment
from tumblecal.data.parquet import pieces_in_order, scan_parquet
from tumblecal.ground.atomic import scratch_folder
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import comments_of, gravity_of_option
from tumblecal.recordings.columns import RATE_KEYS, Layout, given_columns, layout_of, pairs, stated_rate
from tumblecal.recordings.damage import Damage
from tumblecal.recordings.description import described
from tumblecal.recordings.formats import tables_of
from tumblecal.recordings.formats.already_corrected import already_corrected
from tumblecal.recordings.guesses import guessed
from tumblecal.data.column_names import FORCE, LABELS, parsed
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.rows import Unread, WHOLE, left_out, names_of, retained_frames, sample_frames
from tumblecal.recordings.table import Reader, Table
from tumblecal.recordings.units import signed_words


# Clocks with more seconds count from 1970; steps of time that are longer are gaps.
_LEAST_MOMENT_S, LONGEST_STEP_S, _DAY_S = 1e9, 0.5, 86400
# Share of the steps of a regular clock that are within a quarter of the usual one.
_REGULAR, _CHECKED_ROWS = 0.8, 20_000
_SENSOR_WORDS = frozenset("sensor id device imu node channel unit address addr mac tag name source kind type".split())
_MOST_SENSORS = 16


@dataclass(frozen=True)
class Recording:
    """A recording: its samples, and the evidence for their columns.

    **Arguments:**

    - `path`: the source. `reader`, `tables`, `table`: its format, its tables, and the one that was read.
    - `options`: as given. `layout`: columns, units, size of gravity, notes. `damage`: missing and suspicious rows.
    - `unread`: rows without a complete reading. The rest is known after the rows were read:
    - `samples`: the table of samples, a Parquet file: `time_s` from 0, `ax_g` (or `_mg, _ms2, _counts`) .., `gx_dps` ..,
      `temperature_degc`, `position` .. `rows`: their number.
    - `rate_hz`: samples a second, by the times without gaps, as asked for, or as the file states it; None if unknown.
      `slow_hz`: that of a log most of whose steps are gaps for others; None for others.
    - `begin_s`: the source's clock at time zero, `last_s`: the last time, s. `gaps`: time and length, s, of steps of more than
      half a second, or backwards. `equal_times`: samples with the time of the one before. `missing`: samples that a regular
      clock lacks. `mixed_rates`: lowest and highest rate, if they differ by more than a fifth.
    - `temperature`: lowest and highest, degC, and the number of samples without one; None without a temperature.
    """

    path: Path
    reader: Reader
    tables: list[Table]
    table: Table
    options: RecordingOptions
    layout: Layout
    damage: Damage
    unread: Unread = field(default_factory=Unread)
    samples: Path = Path()
    rows: int = 0
    rate_hz: float | None = None
    slow_hz: float | None = None
    begin_s: float = np.nan
    last_s: float = np.nan
    gaps: tuple[tuple[float, float], ...] = ()
    equal_times: int = 0
    missing: int = 0
    mixed_rates: tuple[float, float] | None = None
    temperature: tuple[float, float, int] | None = None

    @property
    def clock_comments(self) -> dict[str, str]:
        """Comments that state when the times were zero: a date if the clock counts from 1970."""
        if not np.isfinite(self.begin_s):
            return {}
        dated = self.begin_s >= _LEAST_MOMENT_S
        return {TIME_ZERO: moment(self.begin_s)} if dated else {TIME_BEGAN: f"{self.begin_s:.6f}"}

    @property
    def comments(self) -> dict[str, str]:
        """Comments of the table of samples: what the source states, gravity, rate, and its name."""
        comments = {key: value for key, value in self.table.stated.items() if key not in RATE_KEYS}
        if self.layout.per_g:
            comments["counts_per_g"] = f"{self.layout.per_g:g}"
        if self.rate_hz and "time" not in self.layout.columns:
            comments["rate_hz"] = f"{self.rate_hz:g}"
        gravity = comments_of(gravity_of_option(self.options.gravity)) if self.options.gravity else {}
        return comments | gravity | {"imported_from": self.path.name}

    @property
    def entries(self) -> dict[str, object]:
        """Rows that are left out and damage, for a file."""
        return {
            "left_out": {"rows": self.unread.rows, "first": self.unread.places},
            "damage": self.damage.lines,
            "damage_records": self.damage.as_dicts(),
        }


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
    layout = layout_of(table, first, options, str(path), only if table.sheet else None)
    if in_g and layout.unit == "counts":
        with guessed(layout.notes):
            layout = _in_g(layout, path)
    return Recording(path, reader, tables, table, options, layout, damage)


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
        _check_signed(rows, recording)
        stated = recording.options.rate or stated_rate(table)
        kept, records = (np.ones(0, bool), []) if means else left_out(rows, layout, rate_of(rows) or stated)
        for record in records:
            recording.damage.add(record)
            if record.kind == "repeats" and stated and record.rows:
                stated *= 1 - record.rows / len(kept)
        clock, first = layout.columns.get("time"), scan_parquet(rows, check=False)[0]
        begin_s = np.nan
        if clock and begin:
            begin_s = begin[0] + clock.offset * (_DAY_S if clock.form else clock.scale) + table.zero_s()
            if records:
                begin_s += float(first.select("time_s").slice(int(np.argmax(kept)), 1).collect().item())
        facts = facts_of(rows, kept if records else None, stated)
        recording = replace(recording, samples=out, begin_s=begin_s, **facts)
        pieces = retained_frames(rows, kept) if records else pieces_in_order(first)
        write_frames(out, pieces, schema, recording.comments)
    return recording


def _check_signed(samples: Path, recording: Recording) -> None:
    """Ask about numbers of which only later rows show that negative ones are written as unsigned ones."""
    columns, named = [recording.layout.columns[role] for role in FORCE], names_of(recording.layout)
    table, rows, _ = scan_parquet(samples, check=False)
    readings = table.select(named[role] for role in FORCE).gather_every(max(1, rows // _CHECKED_ROWS)).collect().to_numpy()
    numbers = np.round(readings / [column.scale for column in columns] + [column.offset for column in columns], 9)
    if words := signed_words([column.name for column in columns], numbers) if not recording.options.signed else "":
        raise InputError(f"{recording.path}: {words}")


def rate_of(samples: Path) -> float | None:
    """Samples a second of a table of samples, by its times without gaps; None without times."""
    return facts_of(samples, None, None)["rate_hz"]


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
    parts = [part for part in np.array_split(whole, max(1, len(whole) // 1000)) if len(part) >= 500 and np.nansum(part) > 0]
    rates = [float(1 / np.nanmean(part)) for part in parts]
    return facts | {
        "slow_hz": 1 / float(np.median(long)) if 2 * len(long) > len(steps) else None,
        "last_s": float(times[-1]),
        "gaps": tuple((float(times[k + 1]), float(steps[k])) for k in np.flatnonzero(gap)),
        "equal_times": equal,
        "mixed_rates": (min(rates), max(rates)) if rates and max(rates) > 1.2 * min(rates) else None,
    }


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
            yield piece.filter((text == value) | number.fill_null(value=False)).select(pl.exclude(name) if name not in columns else pl.all())

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
            raise InputError(f"{path}: column {name} has {len(values)} values in turn: rows of several sensors; select one: {choices}")


def _chosen(path: Path, tables: list[Table], options: RecordingOptions) -> Table:
    """The table with the samples: by option, or the one with accelerations and most rows; tables with rates come first."""
    there = ", ".join(f"{table.name} ({table.words or f'{table.rows} rows'})" for table in tables) or "nothing"
    if options.topic:
        if named := [table for table in tables if table.name == options.topic]:
            return named[0]
        if len(tables) == 1 and not tables[0].name:
            raise InputError(f"{path}: no topic {options.topic}: the file has one table, without a name; remove --topic")
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
