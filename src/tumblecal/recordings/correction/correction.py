"""Correction of readings of any source by a calibration, written in pieces with constant memory."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float

from tumblecal.capture.decoding.sample_table import write_frames
from tumblecal.data.calibration import Calibration
from tumblecal.data.files import stated
from tumblecal.data.position_comments import serial_number_of
from tumblecal.data.raw import CORRECTED_BY, Raw
from tumblecal.data.reading_checks import ReadingChecks
from tumblecal.data.text_layout import ROW
from tumblecal.ground.errors import InputError, one_line
from tumblecal.ground.gravity import SOURCE_KEY, STANDARD, VALUE_KEY, Gravity, comments_of, unit_in_g
from tumblecal.recordings.correction.outside_range import OutsideRange
from tumblecal.recordings.correction.uncorrected import Uncorrected
from tumblecal.recordings.rows import SOURCE_COLUMNS, WHOLE


# The comment with the rows of the source that have no reading and are not in the corrected file.
LEFT_OUT = "left_out"
TEMPERATURE = "temperature_degc"
# A number with a decimal comma, in two parts.
_DECIMAL_COMMA = r"^([+-]?\d*),(\d+(?:[eE][+-]?\d+)?)$"
# Thermal terms are valid this far beyond the temperatures for which they were fitted.
_WARMER_DEGC = 1.0


@dataclass(frozen=True)
class Correction:
    """A calibration for the correction of readings.

    **Arguments:**

    - `calibration` was read from `path`. `local`: gravity at the place of use; readings in g are then written in g of that
      place.
    - `other_unit`: correct readings of another serial number. `extrapolate`: correct readings at temperatures outside the
      measured range of the calibration's curves of temperature.
    """

    calibration: Calibration
    path: Path
    local: Gravity | None = None
    other_unit: bool = False
    extrapolate: bool = False


def write_corrected(
    out: Path, source: Uncorrected, correction: Correction
) -> tuple[ReadingChecks, OutsideRange | None, Gravity | None]:
    """Write a source with its readings replaced by corrected ones.

    A table retains all other columns. Its corrected readings are named `ax_g, ay_g, az_g` (or `_mg`, `_ms2`). For other
    recordings the sample table is written.

    **Returns:** counts of the checks, those of extrapolated rows (None without curves of temperature), and one g in m/s^2 for
    readings in m/s^2 (None for others).

    **Raises:** `InputError` if rows cannot be corrected, are at temperatures outside the curves of temperature and
    `extrapolate` is not set, or are from a different unit; nothing is written then.
    """
    calibration, header = correction.calibration, source.header.in_g_of(correction.calibration.gravity)
    _same_unit(correction, header)
    _check_needs(correction, header)
    local = None if header.in_ms2 else correction.local
    unit_g = _written_unit_g(header, calibration.gravity, local)
    needed = calibration.columns_needed
    checks = ReadingChecks(header.columns, header.row_word, *_temperatures(calibration))
    outside = OutsideRange(calibration.temperature, header.row_word) if calibration.temperature else None

    def corrected(frame: pl.DataFrame) -> Float[np.ndarray, "rows 3"]:
        piece = header.with_rows(frame, checks.rows)
        checks.add(piece.readings, piece.row_numbers)
        inputs = {name: piece.numbers(name) for name in needed}
        if checks.range_degc and TEMPERATURE in frame.columns:
            checks.add_temperatures(inputs.get(TEMPERATURE, piece.numbers_if_any(TEMPERATURE)), piece.row_numbers)
        if outside is not None:
            outside.add(inputs[TEMPERATURE], piece.row_numbers)
            if not correction.extrapolate:
                # Rows outside cause an error after the last one, with their number.
                inputs[TEMPERATURE] = np.clip(inputs[TEMPERATURE], *outside.curves.range_degc)
        force = calibration.corrected(piece.readings, **inputs, extrapolate=True)
        return force if unit_g == 1 else force / unit_g

    def tables() -> Iterator[pl.DataFrame]:
        for frame in source.frames():
            yield _with_force(frame, corrected, renamed, header, commas=commas)
        if outside is not None and not correction.extrapolate:
            outside.require_none(header.path, correction.path)

    commas = source.recording is not None and source.recording.table.decimal == ","
    renamed = dict(zip(source.names or header.columns, header.columns, strict=True))
    _check_names(source, renamed)
    types = {**(source.schema or header.frame.schema), **dict.fromkeys(renamed, pl.Float64)}
    schema = pl.Schema({renamed.get(name, name): kind for name, kind in types.items()})
    comments, notes = _comments(header, correction, local, source.left_out)
    write_frames(out, tables(), schema, comments, [*_comment_lines(header, notes, local), *notes])
    return checks, outside, (header.gravity or STANDARD) if header.in_ms2 else None


def _temperatures(calibration: Calibration) -> tuple[Sequence[float], float]:
    """The temperatures within which a calibration is valid, and its margin beyond: those of its use, otherwise those of its
    data. For a file that does not state its use, the latter apply if it has thermal terms. Curves have a range of their
    own (`OutsideRange`)."""
    if calibration.temperature is not None and calibration.use.temperature_degc in (
        None,
        calibration.temperature.range_degc,
    ):
        return (), 0.0
    if calibration.use.temperature_degc is not None:
        return calibration.use.temperature_degc, 0.0
    counts = calibration.use.answer is not None or TEMPERATURE in calibration.columns_needed
    return calibration.provenance.get("temperature_range_degc") or () if counts else (), _WARMER_DEGC


def _check_names(source: Uncorrected, renamed: Mapping[str, str]) -> None:
    """Check that no other column has one of the names that the corrected readings get.

    **Raises:** `InputError` with the first such name.
    """
    others = set(source.schema or ()) - set(renamed)
    if twice := [name for name in renamed.values() if name in others]:
        raise InputError(
            f"{source.header.path}: column {twice[0]} exists already, but the corrected readings of {', '.join(renamed)} get "
            "this name; rename the column"
        )


def _with_force(
    frame: pl.DataFrame,
    corrected: Callable[[pl.DataFrame], np.ndarray],
    renamed: Mapping[str, str],
    header: Raw,
    *,
    commas: bool,
) -> pl.DataFrame:
    """The complete rows of a piece, as in the source, with corrected readings in these columns under new names. Where commas
    do not separate the cells, a comma in a number is a decimal mark and becomes a point."""
    frame = frame.filter(WHOLE) if WHOLE in frame.columns else frame
    values = corrected(frame)
    columns = (
        frame[SOURCE_COLUMNS].struct.unnest()
        if SOURCE_COLUMNS in frame.columns
        else frame.drop(ROW, WHOLE, strict=False)
    )
    if commas or (header.layout is not None and header.layout.separator != ","):
        columns = columns.with_columns(pl.col(pl.String).str.replace(_DECIMAL_COMMA, "$1.$2"))
    force = (pl.Series(name, np.ascontiguousarray(column)) for name, column in zip(renamed, values.T, strict=True))
    return columns.with_columns(force).rename(renamed)


def _written_unit_g(header: Raw, gravity: Gravity | None, local: Gravity | None) -> float:
    """One unit of the written columns, in g of the calibration: that of the readings or, for columns in g, that of `local`."""
    if local is None or gravity is None:
        return header.to_g
    return unit_in_g(header.unit, None) * local.in_g_of(gravity)


def _comments(
    header: Raw, correction: Correction, local: Gravity | None, left_out: str
) -> tuple[dict[str, str], list[str]]:
    """The comments of the corrected table, and the lines of the new ones."""
    more = (comments_of(local) if local else {}) | {CORRECTED_BY: one_line(str(correction.path))}
    more |= {LEFT_OUT: left_out} if left_out else {}
    return header.comments | more, [f"# {key}: {value}" for key, value in more.items()]


def _comment_lines(header: Raw, notes: Sequence[str], local: Gravity | None) -> list[str]:
    """The comment lines before a CSV table of a source that is not text, without the keys that `notes` replace."""
    new = stated(notes).keys() | ({VALUE_KEY, SOURCE_KEY} if local else set())
    return [f"# {key}: {value}" for key, value in header.comments.items() if key not in new]


def _same_unit(correction: Correction, header: Raw) -> None:
    """Raise for readings of a different unit.

    **Raises:** `InputError` if the serial numbers differ, unless `other_unit` is set.
    """
    serial, stated = correction.calibration.serial_number, serial_number_of(header.comments)
    if serial and stated and stated != serial and not correction.other_unit:
        raise InputError(
            f"{header.path}: serial number {stated}, but {correction.path} is of {serial}; give that unit's calibration, or "
            "--other-unit to insist"
        )


def _check_needs(correction: Correction, header: Raw) -> None:
    lacking = [name for name in correction.calibration.columns_needed if name not in header.frame.columns]
    if lacking:
        kind = {"temperature_degc": "temperature", "time_s": "drift"}[lacking[0]]
        role = lacking[0].partition("_")[0]
        raise InputError(
            f"{header.path}: no column {lacking[0]}, but {correction.path} has {kind} terms; give it "
            f"(--columns {role}=...), or give a calibration without them"
        )
