"""Readings before correction: tables or recordings of any format, and the damage of their rows."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import polars as pl

from tumblecal.capture.columns.number_range import Wrap
from tumblecal.capture.columns.units import FORCE, RATE, Column
from tumblecal.capture.correction.correction_damage import RowDamage, left_out_words, row_damage
from tumblecal.capture.recordings.damage import Damage
from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.capture.rows.contents import Contents
from tumblecal.capture.rows.sample_file import SampleStream, sample_stream
from tumblecal.data.calibration import Calibration
from tumblecal.data.named_layout import readings_among
from tumblecal.data.raw import Raw, column_names, header_of, opened_raw
from tumblecal.ground.errors import InputError


# The comment with the scale of counts; corrected readings are in g.
COUNTS = "counts_per_g"


@dataclass(frozen=True)
class Uncorrected:
    """A source of readings.

    **Arguments:**

    - `header`: its columns and comments, without rows; the columns are those for a correction.
    - `frames`: rows in pieces, with the columns of a table that retains them.
    - `schema`: these columns, None for other recordings; `names`: names of its readings.
    - `contents`: contents of a recording. `damage`: damage of its rows.
    - `left_out`: the rows without a reading, which are left out, in words; empty for none.
    """

    header: Raw
    frames: Callable[[], Iterator[pl.DataFrame]]
    schema: pl.Schema | None = None
    names: tuple[str, ...] = ()
    contents: Contents | None = None
    damage: Damage = field(default_factory=Damage)
    left_out: str = ""

    def out_beside(self, path: Path) -> Path:
        """The default name of the corrected file: CSV for a table that is not Parquet."""
        suffix = ".parquet" if self.schema is None or path.suffix == ".parquet" else ".csv"
        return path.with_name(f"{path.stem}_corrected{suffix}")


def uncorrected(
    source: Path, options: RecordingOptions = RecordingOptions(), calibration: Calibration | None = None
) -> Uncorrected:
    """A table with columns `ax_g, ay_g, az_g` (or `_mg`, `_ms2`), unchanged, or a recording of any format. Columns of a table
    that the calibration does not need may have any content.

    **Raises:** `InputError` for a source that cannot be read, has no readings, or has corrected ones.
    """
    if options == RecordingOptions() and source.is_file():
        names = column_names(source)
        if readings_among(names) or not names:
            header, frames = opened_raw(source)
            found = row_damage(header, frames(), [Column(name) for name in header.columns])
            return Uncorrected(
                header,
                lambda: found.marked(frames()),
                header.frame.schema,
                header.columns,
                damage=found.damage,
                left_out=left_out_words(header.row_word, found.marked(frames())) if found.erased.any() else "",
            )
    needed = () if calibration is None else [name.partition("_")[0] for name in calibration.columns_needed]
    return _recording(source, options, needed)


def _recording(source: Path, options: RecordingOptions, needed: Sequence[str]) -> Uncorrected:
    """A recording of any format; these quantities are needed in addition to the accelerations."""
    found = _damage_of(source, options, needed)

    def stream() -> SampleStream:
        return sample_stream(source, options, in_force_units=True, needed=(*FORCE, *needed), wraps=found.wraps)

    samples = stream()
    contents, schema = samples.contents, samples.schema
    table, columns = contents.layout.table, contents.layout.columns
    left_out = "" if found.all_usable else left_out_words(table.row_word, found.marked(stream().frames_with(())))
    for record in found.damage.records:
        contents.damage.add(record)
    if not table.sheet:
        comments = {key: value for key, value in samples.comments.items() if key not in (COUNTS, "imported_from")}
        header = replace(header_of(source, schema.to_frame(), comments), row_word=table.row_word)
        rows = lambda: found.marked(samples.frames_with(()))  # noqa: E731
        return Uncorrected(header, rows, contents=contents, damage=contents.damage, left_out=left_out)
    names, axes = table.columns, [columns[axis] for axis in FORCE]
    new_unit = any(axis.scale != 1 or axis.offset != 0 for axis in axes)
    comments = {key: value for key, value in table.comments.items() if not (new_unit and key == COUNTS)}
    return Uncorrected(
        replace(header_of(source, schema.to_frame(), comments), row_word=table.row_word),
        lambda: found.marked(samples.frames_with(names)),
        next(table.pieces(names)).head(0).select(names).schema,
        tuple(axis.name for axis in axes),
        contents,
        contents.damage,
        left_out,
    )


def _damage_of(source: Path, options: RecordingOptions, needed: Sequence[str]) -> RowDamage:
    """The damage of a recording's rows, also by its times and rates if these can be read."""

    def found(roles: Sequence[str], wraps: Mapping[str, Wrap] = MappingProxyType({})) -> RowDamage:
        stream = sample_stream(source, options, in_force_units=True, needed=roles, wraps=wraps)
        axes = [stream.contents.layout.columns[axis] for axis in FORCE]
        header = header_of(source, stream.schema.to_frame(), {})
        damage = row_damage(header, stream.frames_with(()), axes, stream.contents)
        return found(roles, damage.wraps) if damage.wraps else replace(damage, wraps=wraps)

    try:
        return found((*FORCE, *needed, *RATE, "time"))
    except InputError:
        return found((*FORCE, *needed))
