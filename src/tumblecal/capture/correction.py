"""Readings of any source corrected by a calibration and written, a piece at a time: memory does not grow with them."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from tumblecal.capture.recordings.options import Asked
from tumblecal.capture.recordings.sample_file import Contents, sample_stream
from tumblecal.capture.sample_table import write_frames
from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_extended import columns_needed
from tumblecal.data.csv_layout import readings_among
from tumblecal.data.files import stated
from tumblecal.data.positions import serial_number_of
from tumblecal.data.raw import CORRECTED_BY, Raw, column_names, frames_of, header_of, opened_raw
from tumblecal.data.reading_checks import ReadingChecks
from tumblecal.ground.errors import InputError, one_line
from tumblecal.ground.gravity import SOURCE_KEY, STANDARD, VALUE_KEY, Gravity, comments_of, unit_in_g


if TYPE_CHECKING:
    import polars as pl


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
    """A source: what it states (`header`, without rows), its rows a piece at a time, and what a recording holds."""

    header: Raw
    frames: Iterator["pl.DataFrame"]
    contents: Contents | None = None


def uncorrected(source: Path, asked: Asked = Asked()) -> Uncorrected:
    """A table with columns `ax_g, ay_g, az_g` (or `_mg`, `_ms2`) as it stands, or the sample table of a recording.

    **Raises:** `InputError` for a source that cannot be read, holds no readings, or corrected ones.
    """
    if asked == Asked() and source.is_file():
        names = column_names(source)
        if readings_among(names) or not names:
            header, table = opened_raw(source)
            return Uncorrected(header, frames_of(header, table))
    stream = sample_stream(source, asked, in_force_units=True)
    comments = {key: value for key, value in stream.comments.items() if key not in ("counts_per_g", "imported_from")}
    return Uncorrected(header_of(source, stream.schema.to_frame(), comments), stream.frames, stream.contents)


def write_corrected(out: Path, source: Uncorrected, correction: Correction) -> tuple[ReadingChecks, Gravity | None]:
    """Write a source with its readings replaced by corrected ones, in its own unit; other columns stay as they are.

    **Returns:** what was counted, and what one g of readings in m/s^2 is (None for others).

    **Raises:** `InputError` where rows cannot be corrected, or are another unit's; nothing is written then.
    """
    calibration, header = correction.calibration, source.header.in_g_of(correction.calibration.gravity)
    _same_unit(correction, header)
    _check_needs(correction, header)
    local = None if header.in_ms2 else correction.local
    unit_g = _written_unit_g(header, calibration.gravity, local)
    needed = columns_needed(calibration)
    checks = ReadingChecks(
        header.columns,
        header.row_word,
        calibration.provenance.get("temperature_range_degc") or () if "temperature_degc" in needed else (),
        lambda row: header.places.line_of(row - 1),
    )

    def frames() -> Iterator["pl.DataFrame"]:
        for frame in source.frames:
            piece = header.with_rows(frame, checks.rows)
            checks.add(piece.readings, piece.before + 1)
            beside = {name: piece.numbers(name) for name in needed}
            if "temperature_degc" in beside:
                checks.add_temperatures(beside["temperature_degc"], piece.before + 1)
            force = calibration.corrected(piece.readings, **beside)
            yield _with_force(piece, force, unit_g)

    write_frames(
        *(out, frames(), _schema(header), *_comments(header, correction, local)),
        separator=header.separator,
        decimal_comma=header.decimal == ",",
    )
    return checks, (header.gravity or STANDARD) if header.in_ms2 else None


def _written_unit_g(header: Raw, gravity: Gravity | None, local: Gravity | None) -> float:
    """One unit of the columns written, in g of the calibration: that of the readings, or, of columns in g, that of `local`."""
    if local is None or gravity is None:
        return header.to_g
    return unit_in_g(header.unit, None) * local.in_g_of(gravity)


def _with_force(piece: Raw, force: Float[np.ndarray, "rows 3"], unit_g: float) -> "pl.DataFrame":
    """A piece with its readings replaced by forces in g, in a unit of so many g."""
    import polars as pl

    values = force if unit_g == 1 else force / unit_g
    columns = zip(piece.columns, values.T, strict=True)
    return piece.frame.with_columns(pl.Series(name, np.ascontiguousarray(own)) for name, own in columns)


def _schema(header: Raw) -> "pl.Schema":
    import polars as pl

    return pl.Schema({**header.frame.schema, **dict.fromkeys(header.columns, pl.Float64)})


def _comments(header: Raw, correction: Correction, local: Gravity | None) -> tuple[dict[str, str], list[str]]:
    """The comments of the corrected table, and the lines in which they stand before a CSV table."""
    more = (comments_of(local) if local else {}) | {CORRECTED_BY: one_line(str(correction.path))}
    own = [line for line in header.lines if not (local and stated([line]).keys() & {VALUE_KEY, SOURCE_KEY})]
    own = own or [f"# {key}: {value}" for key, value in header.comments.items() if key not in more]
    return header.comments | more, [*own, *(f"# {key}: {value}" for key, value in more.items())]


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
    lacking = [name for name in columns_needed(correction.calibration) if name not in header.frame.columns]
    if lacking:
        kind = {"temperature_degc": "temperature", "time_s": "drift"}[lacking[0]]
        role = lacking[0].partition("_")[0]
        raise InputError(
            f"{header.path}: no column {lacking[0]}, but {correction.path} has {kind} terms; say which it is "
            f"(--columns {role}=...), or give a calibration without them"
        )
