"""Readings before correction: tables of this program, or recordings of any format."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl

from tumblecal.data.calibration import Calibration
from tumblecal.data.column_names import FORCE
from tumblecal.data.named_layout import readings_among
from tumblecal.data.raw import Raw, column_names, header_of, opened_raw
from tumblecal.data.text_layout import ROW
from tumblecal.recordings.description import SUFFIX
from tumblecal.recordings.opening import opened
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.rows import WHOLE, Unread, sample_frames, schema_of


# The comment with the scale of counts; corrected readings are in g.
COUNTS = "counts_per_g"
_MOST_RANGES = 200


@dataclass(frozen=True)
class Uncorrected:
    """A source of readings.

    **Arguments:**

    - `header`: its columns and comments, without rows; the columns are those for a correction.
    - `frames`: rows in pieces, with the columns of a table that retains them.
    - `schema`: these columns, None for other recordings; `names`: names of its readings.
    - `recording`: a recording; None for a table of this program.
    - `left_out`: the rows without a reading, which are left out, in words; empty for none.
    """

    header: Raw
    frames: Callable[[], Iterator[pl.DataFrame]]
    schema: pl.Schema | None = None
    names: tuple[str, ...] = ()
    recording: Recording | None = None
    left_out: str = ""

    def out_beside(self, path: Path) -> Path:
        """The default name of the corrected file: CSV for a table that is not Parquet."""
        suffix = ".parquet" if self.schema is None or path.suffix == ".parquet" else ".csv"
        return path.with_name(f"{path.stem}_corrected{suffix}")


def uncorrected(
    source: Path, options: RecordingOptions = RecordingOptions(), calibration: Calibration | None = None
) -> Uncorrected:
    """A table with columns `ax_g, ay_g, az_g` (or `_mg`, `_ms2`), or a recording of any format. Columns of a table that
    the calibration does not need may have any content.

    **Raises:** `InputError` for a source that cannot be read, has no readings, or has corrected ones.
    """
    if options == RecordingOptions() and source.is_file() and not source.name.endswith(SUFFIX):
        names = column_names(source)
        if readings_among(names) or not names:
            header, pieces = opened_raw(source)
            return Uncorrected(header, pieces, header.frame.schema, header.columns)
    needed = () if calibration is None else [name.partition("_")[0] for name in calibration.columns_needed]
    recording = opened(source, options, in_g=True, only=(*FORCE, *needed))
    table, layout = recording.table, recording.layout

    def frames(more: Sequence[str]) -> Iterator[pl.DataFrame]:
        return sample_frames(table, layout, str(source), Unread(), [], more)

    lost = [frame.filter(~pl.col(WHOLE))[ROW].to_numpy() for frame in frames(())]
    axes = [layout.columns[axis] for axis in FORCE]
    unchanged = table.sheet and all(axis.scale == 1 and axis.offset == 0 for axis in axes)
    dropped = () if unchanged else (COUNTS, "imported_from")
    comments = {key: value for key, value in recording.comments.items() if key not in dropped and key in table.stated}
    header = replace(header_of(source, schema_of(layout).to_frame(), comments), row_word=table.row_word)
    more = table.columns if table.sheet else ()
    kinds = next(iter(table.pieces(more))).select(more).schema if more else None
    names = tuple(axis.name for axis in axes) if more else ()
    left_out = _left_out_words(table.row_word, np.concatenate(lost))
    return Uncorrected(header, lambda: frames(more), kinds, names, recording, left_out)


def _left_out_words(row_word: str, places: np.ndarray) -> str:
    """The rows of a source that are not `WHOLE`, such as `lines 52 to 71, 300`; empty for none."""
    spans = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1) if len(places) else []
    words = [f"{span[0]} to {span[-1]}" if len(span) > 1 else f"{span[0]}" for span in spans[:_MOST_RANGES]]
    words += [f"and {sum(map(len, spans[_MOST_RANGES:]))} more"] if len(spans) > _MOST_RANGES else []
    return f"{row_word}{'s' if len(places) > 1 else ''} {', '.join(words)}" if words else ""
