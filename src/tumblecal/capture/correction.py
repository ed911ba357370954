"""Readings of any source corrected by a calibration and written, a piece at a time: memory does not grow with them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from tumblecal.capture.corrected_text import HeaderChanges, TextCells, replaced_text
from tumblecal.capture.recordings.contents import Contents
from tumblecal.capture.recordings.options import Asked
from tumblecal.capture.recordings.sample_file import sample_stream
from tumblecal.capture.recordings.sample_frames import OWN, WHOLE
from tumblecal.capture.recordings.units import FORCE
from tumblecal.capture.sample_table import write_bytes, write_frames
from tumblecal.data.calibration import Calibration
from tumblecal.data.files import stated
from tumblecal.data.named_layout import readings_among
from tumblecal.data.positions import serial_number_of
from tumblecal.data.raw import CORRECTED_BY, Raw, column_names, header_of, opened_raw
from tumblecal.data.reading_checks import ReadingChecks
from tumblecal.data.text_layout import ROW
from tumblecal.ground.decimal_marks import marks_of
from tumblecal.ground.errors import InputError, one_line
from tumblecal.ground.gravity import SOURCE_KEY, STANDARD, VALUE_KEY, Gravity, comments_of, unit_in_g


if TYPE_CHECKING:
    import polars as pl


# The comment that says what makes counts of readings; corrected ones are in g.
COUNTS = "counts_per_g"
TEMPERATURE = "temperature_degc"
# So far beyond the temperatures for which thermal terms were fitted they still hold.
_WARMER_DEGC = 1.0
# So many rows tell the decimal mark of a table.
_SEEN_ROWS = 1000


@dataclass(frozen=True)
class Correction:
    """What corrects readings.

    **Arguments:**

    - `calibration` was read from `path`. `local`: gravity where the device is used; readings in g are then written in g of
      there.
    - `other_unit`: correct readings of another serial number.
    """

    calibration: Calibration
    path: Path
    local: Gravity | None = None
    other_unit: bool = False


@dataclass(frozen=True)
class Uncorrected:
    """A source of readings.

    **Arguments:**

    - `header`: what it states, without rows; its columns are those that a correction takes.
    - `frames`: rows a piece at a time. With True the pieces of a table that is kept (`schema`) have its own columns too.
    - `schema`: the own columns of a table that is kept, None for other recordings; `names` are those of its readings.
    - `text`: where the readings of a text table are. `contents`: what a recording holds.
    - `new_unit`: whether the readings are in a unit of their own (counts, scaled), so that corrected ones are in another.
    """

    header: Raw
    frames: Callable[[bool], Iterator["pl.DataFrame"]]
    schema: "pl.Schema | None" = None
    names: tuple[str, ...] = ()
    text: TextCells | None = None
    contents: Contents | None = None
    new_unit: bool = False

    def out_beside(self, path: Path) -> Path:
        """The name of the corrected file where none is given: of the same format, where that can be written."""
        suffix = path.suffix if self.text or path.suffix == ".parquet" else ".parquet"
        return path.with_name(f"{path.stem}_corrected{suffix}")

    def same_format(self, out: Path) -> bool:
        """Whether a file to be written has the format of the source."""
        return self.text is not None if out.suffix != ".parquet" else self.header.path.suffix == ".parquet"


def uncorrected(source: Path, asked: Asked = Asked(), calibration: Calibration | None = None) -> Uncorrected:
    """A table with columns `ax_g, ay_g, az_g` (or `_mg`, `_ms2`) as it stands, or a recording of any format; of a table
    whose columns are kept, those that the calibration does not need may hold anything.

    **Raises:** `InputError` for a source that cannot be read, holds no readings, or corrected ones.
    """
    if asked == Asked() and source.is_file():
        names = column_names(source)
        if readings_among(names) or not names:
            header, frames = opened_raw(source)
            return Uncorrected(
                header, lambda _: frames(), header.frame.schema, header.columns, _cells_of(header, frames)
            )
    needed = () if calibration is None else [name.partition("_")[0] for name in calibration.columns_needed]
    stream = sample_stream(source, asked, in_force_units=True, needed=(*FORCE, *needed))
    layout = stream.contents.layout
    if not layout.table.sheet:
        comments = {key: value for key, value in stream.comments.items() if key not in (COUNTS, "imported_from")}
        header = header_of(source, stream.schema.to_frame(), comments)
        return Uncorrected(header, lambda _: stream.frames, contents=stream.contents)
    own, axes, text = layout.table.columns, [layout.columns[axis] for axis in FORCE], layout.table.text
    new_unit = any(axis.scale != 1 or axis.offset != 0 for axis in axes)
    comments = {key: value for key, value in layout.table.comments.items() if not (new_unit and key == COUNTS)}
    header = header_of(source, stream.schema.to_frame(), comments)
    return Uncorrected(
        header,
        lambda whole: stream.frames_with(own if whole else ()),
        next(layout.table.pieces(own)).head(0).select(own).schema,
        tuple(axis.name for axis in axes),
        text and replace(text, places=tuple(own.index(axis.name) for axis in axes)),
        stream.contents,
        new_unit,
    )


def _cells_of(header: Raw, frames: Callable[[], Iterator["pl.DataFrame"]]) -> TextCells | None:
    """Where a table of text has its readings; its decimal mark is that of other columns if theirs does not show it."""
    if header.layout is None:
        return None
    decimal = header.decimal
    if decimal is None:
        seen = next(piece for piece in frames() if len(piece)).head(_SEEN_ROWS).drop(ROW)
        marks = marks_of([[cell for cell in column.to_list() if cell] for column in seen.iter_columns()])
        decimal = "," if any(own and own[0] == "," for own in marks) else "."
    places = tuple(header.layout.names.index(name) for name in header.columns)
    return TextCells(header.layout, places, decimal)


def write_corrected(out: Path, source: Uncorrected, correction: Correction) -> tuple[ReadingChecks, Gravity | None]:
    """Write a source with its readings replaced by corrected ones.

    A table of text or Parquet keeps all else: in its own format text is the same byte for byte, and readings stay in their
    unit under their names. In another format, or where they were counts, they are named `ax_g, ay_g, az_g` (or `_mg`,
    `_ms2`). Of other recordings the sample table is written.

    **Returns:** what was counted, and what one g of readings in m/s^2 is (None for others).

    **Raises:** `InputError` where rows cannot be corrected, or are another unit's; nothing is written then.
    """
    import polars as pl

    calibration, header = correction.calibration, source.header.in_g_of(correction.calibration.gravity)
    _same_unit(correction, header)
    _check_needs(correction, header)
    local = None if header.in_ms2 else correction.local
    unit_g = _written_unit_g(header, calibration.gravity, local)
    needed = calibration.columns_needed
    checks = ReadingChecks(
        header.columns,
        header.row_word,
        *_temperatures(calibration),
        lambda row: header.layout.line_of(row - 1) if header.layout else row,
    )

    def corrected(frame: "pl.DataFrame") -> Float[np.ndarray, "rows 3"]:
        piece = header.with_rows(frame, checks.rows)
        checks.add(piece.readings, piece.before + 1)
        beside = {name: piece.numbers(name) for name in needed}
        if checks.range_degc and TEMPERATURE in frame.columns:
            checks.add_temperatures(beside.get(TEMPERATURE, piece.numbers_if_any(TEMPERATURE)), piece.before + 1)
        force = calibration.corrected(piece.readings, **beside)
        return force if unit_g == 1 else force / unit_g

    def all_rows() -> Iterator[Float[np.ndarray, "rows 3"]]:
        for frame in source.frames(False):
            if WHOLE not in frame.columns:
                yield corrected(frame)
                continue
            values = np.full((len(frame), 3), np.nan)
            values[frame[WHOLE].to_numpy()] = corrected(frame.filter(WHOLE))
            yield values

    same = source.same_format(out)
    own = source.names if source.schema is not None else header.columns
    names = own if same and not source.new_unit else header.columns
    _check_names(source, own, names)
    comments, notes = _comments(header, correction, local)
    if same and source.text is not None:
        removed = frozenset([*((VALUE_KEY, SOURCE_KEY) if local else ()), *([COUNTS] if source.new_unit else ())])
        changes = HeaderChanges(notes, removed, names if names != own else ())
        write_bytes(out, replaced_text(header.path, source.text, all_rows(), changes))
    else:
        types = {**(source.schema or header.frame.schema), **dict.fromkeys(own, pl.Float64)}
        renamed = dict(zip(own, names, strict=True))
        schema = pl.Schema({renamed.get(name, name): kind for name, kind in types.items()})
        frames = (_with_force(frame, corrected, renamed) for frame in source.frames(True))
        write_frames(out, frames, schema, comments, [*_own_lines(header, notes, local), *notes])
    return checks, (header.gravity or STANDARD) if header.in_ms2 else None


def _temperatures(calibration: Calibration) -> tuple[Sequence[float], float]:
    """The temperatures within which a calibration holds, and how far beyond it holds as well: those of its use, otherwise those
    of its data. For a file that does not state its use these count if it has thermal terms."""
    if calibration.use.temperature_degc is not None:
        return calibration.use.temperature_degc, 0.0
    counts = calibration.use.answer is not None or TEMPERATURE in calibration.columns_needed
    return calibration.provenance.get("temperature_range_degc") or () if counts else (), _WARMER_DEGC


def _check_names(source: Uncorrected, own: Sequence[str], names: Sequence[str]) -> None:
    """Refuse names for the corrected readings, in `own` columns, that other columns have.

    **Raises:** `InputError` naming the first.
    """
    others = set(source.schema or ()) - set(own)
    if twice := [name for name in names if name in others]:
        raise InputError(
            f"{source.header.path}: column {twice[0]} is there already, beside {', '.join(own)}, whose corrected readings "
            "get that name; rename it"
        )


def _with_force(
    frame: "pl.DataFrame", corrected: Callable[["pl.DataFrame"], np.ndarray], renamed: Mapping[str, str]
) -> "pl.DataFrame":
    """The whole rows of a piece, as in the source, with corrected readings in these columns under new names."""
    import polars as pl

    frame = frame.filter(WHOLE) if WHOLE in frame.columns else frame
    values = corrected(frame)
    kept = frame[OWN].struct.unnest() if OWN in frame.columns else frame.drop(ROW, strict=False)
    force = (pl.Series(name, np.ascontiguousarray(own)) for name, own in zip(renamed, values.T, strict=True))
    return kept.with_columns(force).rename(renamed)


def _written_unit_g(header: Raw, gravity: Gravity | None, local: Gravity | None) -> float:
    """One unit of the columns written, in g of the calibration: that of the readings, or, of columns in g, that of `local`."""
    if local is None or gravity is None:
        return header.to_g
    return unit_in_g(header.unit, None) * local.in_g_of(gravity)


def _comments(header: Raw, correction: Correction, local: Gravity | None) -> tuple[dict[str, str], list[str]]:
    """The comments of the corrected table, and the lines of those that are new."""
    more = (comments_of(local) if local else {}) | {CORRECTED_BY: one_line(str(correction.path))}
    return header.comments | more, [f"# {key}: {value}" for key, value in more.items()]


def _own_lines(header: Raw, notes: Sequence[str], local: Gravity | None) -> list[str]:
    """The lines before a CSV table of a source that is no text: what it states, less what `notes` state anew."""
    new = stated(notes).keys() | ({VALUE_KEY, SOURCE_KEY} if local else set())
    return [f"# {key}: {value}" for key, value in header.comments.items() if key not in new]


def _same_unit(correction: Correction, header: Raw) -> None:
    """Refuse readings of another unit.

    **Raises:** `InputError` where the serial numbers differ and nobody insisted.
    """
    own, theirs = correction.calibration.serial_number, serial_number_of(header.comments)
    if own and theirs and theirs != own and not correction.other_unit:
        raise InputError(
            f"{header.path}: serial number {theirs}, but {correction.path} is of {own}; give that unit's calibration, or "
            "--other-unit to insist"
        )


def _check_needs(correction: Correction, header: Raw) -> None:
    lacking = [name for name in correction.calibration.columns_needed if name not in header.frame.columns]
    if lacking:
        kind = {"temperature_degc": "temperature", "time_s": "drift"}[lacking[0]]
        role = lacking[0].partition("_")[0]
        raise InputError(
            f"{header.path}: no column {lacking[0]}, but {correction.path} has {kind} terms; say which it is "
            f"(--columns {role}=...), or give a calibration without them"
        )
