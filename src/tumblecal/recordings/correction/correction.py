"""Correction of readings of any source by a calibration, written in pieces with constant memory."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float, Int

from tumblecal.capture.decoding.sample_table import write_frames
from tumblecal.capture.decoding.samples import Floats
from tumblecal.data.calibration import Calibration
from tumblecal.data.position_comments import serial_number_of
from tumblecal.data.raw import CORRECTED_BY, Raw
from tumblecal.data.reading_checks import Occurrences, ReadingChecks
from tumblecal.data.sensor_parameters import GROUPS, SENSOR, leaf_of
from tumblecal.data.temperature_curves import TemperatureCurves
from tumblecal.data.text_layout import ROW
from tumblecal.ground.decimal_marks import DECIMAL_COMMA
from tumblecal.ground.errors import InputError, one_line
from tumblecal.ground.gravity import SOURCE_KEY, STANDARD, VALUE_KEY, Gravity, comments_of, unit_in_g
from tumblecal.ground.units import in_words, shown
from tumblecal.recordings.correction.uncorrected import Uncorrected
from tumblecal.recordings.rows import SOURCE_COLUMNS, WHOLE


@dataclass
class OutsideRange:
    """Counts of such rows, piece by piece; `farthest_degc`: the temperature with the largest distance from the range."""

    curves: TemperatureCurves
    row_word: str
    rows: int = 0
    at: Occurrences = field(default_factory=Occurrences)
    farthest_degc: float | None = None

    def add(self, degc: Float[np.ndarray, " rows"], rows: Int[np.ndarray, " rows"]) -> None:
        """Count the temperatures of a piece; `rows`: the number of each row."""
        self.rows += len(degc)
        if (beyond := self.curves.beyond(degc)).any():
            self.at.add(rows[beyond])
            known = degc if self.farthest_degc is None else np.append(self.farthest_degc, degc)
            self.farthest_degc = float(known[np.argmax(np.abs(known - np.clip(known, *self.curves.range_degc)))])

    @property
    def _counted(self) -> str:
        return (
            f"temperatures in {self.at.count} of {self.rows} rows (the first: {self.row_word} {self.at.first}) are outside "
            f"the measured {self.curves.range_words}, up to {self.farthest_degc:.4g} degC"
        )

    def require_none(self, source: Path, calibration: Path) -> None:
        """Reject rows outside the range.

        **Raises:** `InputError` with their number, the range and the remedy.
        """
        if self.farthest_degc is not None:
            cure = "remove these rows, or give --extrapolate to correct them with a larger uncertainty"
            raise InputError(f"{source}: {self._counted}, where {calibration} was not measured; {cure}")

    def words(self) -> Iterator[str]:
        """The warning on extrapolated rows, with the standard uncertainties at the farthest temperature."""
        if self.farthest_degc is None:
            return
        end = float(np.clip(self.farthest_degc, *self.curves.range_degc))
        here, at_end = self.curves.sd(np.array([self.farthest_degc, end]))
        followed = [SENSOR.index(curve.parameter) for curve in self.curves.curves if curve.functions.count]
        # The largest of each kind of parameter.
        largest = {leaf_of(SENSOR[k]): k for k in sorted(followed, key=lambda place: here[place])}
        sizes = []
        for leaf in sorted(largest, key=[*GROUPS].index):
            k, (unit, scale) = largest[leaf], shown(GROUPS[leaf][1])
            size = in_words(f"{here[k] * scale:.2g}", unit)
            sizes.append(f"{size} for {SENSOR[k]} ({at_end[k] * scale:.2g} at {end:.4g} degC)")
        yield (
            f"extrapolated: {self._counted}. The largest standard uncertainties there are {', '.join(sizes)}, if the "
            "dependence on temperature continues"
        )


# The comment with the rows of the source that have no reading and are not in the corrected file.
LEFT_OUT = "left_out"
TEMPERATURE = "temperature_degc"
# Thermal terms are valid this far beyond the temperatures for which they were fitted.
_WARMER_DEGC = 1.0


def write_corrected(
    out: Path,
    source: Uncorrected,
    calibration: Calibration,
    path: Path,
    local: Gravity | None = None,
    *,
    other_unit: bool = False,
    extrapolate: bool = False,
) -> tuple[ReadingChecks, OutsideRange | None, Gravity | None]:
    """Write a source with its readings replaced by corrected ones.

    A table retains all other columns. Its corrected readings are named `ax_g, ay_g, az_g` (or `_mg`, `_ms2`). For other
    recordings the sample table is written.

    **Arguments:**

    - `calibration` was read from `path`. `local`: gravity at the place of use; readings in g are then written in g of that
      place.
    - `other_unit`: correct readings of another serial number. `extrapolate`: correct readings at temperatures outside the
      measured range of the calibration's curves of temperature.

    **Returns:** counts of the checks, those of extrapolated rows (None without curves of temperature), and one g in m/s^2 for
    readings in m/s^2 (None for others).

    **Raises:** `InputError` if rows cannot be corrected, are at temperatures outside the curves of temperature and
    `extrapolate` is not set, or are from a different unit; nothing is written then.
    """
    header = source.header.in_g_of(calibration.gravity)
    local = None if header.in_ms2 else local
    renamed = dict(zip(source.names or header.columns, header.columns, strict=True))
    types = {**(source.schema or header.frame.schema), **dict.fromkeys(renamed, pl.Float64)}
    calibration.require_unit(path, str(header.path), serial_number_of(header.comments), other=other_unit)
    _check(calibration, path, header, renamed, types)
    # One unit of the written columns, in g of the calibration: that of the readings or, for columns in g, that of `local`.
    unit_g = header.to_g
    if local and calibration.gravity:
        unit_g = unit_in_g(header.unit, None) * local.in_g_of(calibration.gravity)
    checks = ReadingChecks(header.columns, header.row_word, *_temperatures(calibration))
    outside = OutsideRange(calibration.temperature, header.row_word) if calibration.temperature else None

    def corrected(frame: pl.DataFrame) -> Floats:
        piece = header.with_rows(frame, checks.rows)
        checks.add(piece.readings, piece.row_numbers)
        inputs = {name: piece.numbers(name) for name in calibration.columns_needed}
        if checks.range_degc and TEMPERATURE in frame.columns:
            checks.add_temperatures(inputs.get(TEMPERATURE, piece.numbers_if_any(TEMPERATURE)), piece.row_numbers)
        if outside is not None:
            outside.add(inputs[TEMPERATURE], piece.row_numbers)
            if not extrapolate:
                # Rows outside cause an error after the last one, with their number.
                inputs[TEMPERATURE] = np.clip(inputs[TEMPERATURE], *outside.curves.range_degc)
        return calibration.corrected(piece.readings, **inputs, extrapolate=True) / unit_g

    def tables() -> Iterator[pl.DataFrame]:
        for piece in source.frames():
            frame = piece.filter(WHOLE) if WHOLE in piece.columns else piece
            values = corrected(frame)
            force = [pl.Series(name, np.ascontiguousarray(axis)) for name, axis in zip(renamed, values.T, strict=True)]
            # All columns of the source, with decimal points, and the corrected readings under their new names.
            of_source = SOURCE_COLUMNS in frame.columns
            columns = frame[SOURCE_COLUMNS].struct.unnest() if of_source else frame.drop(ROW, WHOLE, strict=False)
            if header.layout is not None and header.layout.separator != ",":
                columns = columns.with_columns(pl.col(pl.String).str.replace(DECIMAL_COMMA, "$1.$2"))
            yield columns.with_columns(force).rename(renamed)
        if outside is not None and not extrapolate:
            outside.require_none(header.path, path)

    schema = pl.Schema({renamed.get(name, name): kind for name, kind in types.items()})
    replaced = (VALUE_KEY, SOURCE_KEY) if local else ()
    comments = {key: value for key, value in header.comments.items() if key not in replaced}
    comments |= (comments_of(local) if local else {}) | {CORRECTED_BY: one_line(str(path))}
    comments |= {LEFT_OUT: source.left_out} if source.left_out else {}
    write_frames(out, tables(), schema, comments)
    return checks, outside, (header.gravity or STANDARD) if header.in_ms2 else None


def _temperatures(calibration: Calibration) -> tuple[Sequence[float], float]:
    """The temperatures within which a calibration is valid, and its margin beyond: those of its use, otherwise those of its
    data. For a file that does not state its use, the latter apply if it has thermal terms. Curves have a range of their
    own (`OutsideRange`)."""
    use, curves = calibration.use, calibration.temperature
    if curves is not None and use.temperature_degc in (None, curves.range_degc):
        return (), 0.0
    if use.temperature_degc is not None:
        return use.temperature_degc, 0.0
    counts = use.answer is not None or TEMPERATURE in calibration.columns_needed
    return calibration.provenance.get("temperature_range_degc") or () if counts else (), _WARMER_DEGC


def _check(calibration: Calibration, path: Path, header: Raw, renamed: dict[str, str], types: dict) -> None:
    """Check that the source has the inputs of the calibration, and that names of columns remain unique.

    **Raises:** `InputError`.
    """
    for name in calibration.columns_needed:
        if name not in header.frame.columns:
            kind = {TEMPERATURE: "temperature", "time_s": "drift"}[name]
            cure = f"give it (--columns {name.partition('_')[0]}=...), or give a calibration without them"
            raise InputError(f"{header.path}: no column {name}, but {path} has {kind} terms; {cure}")
    if twice := [name for name in renamed.values() if name in types and name not in renamed]:
        words = f"column {twice[0]} exists already, but the corrected readings of {', '.join(renamed)} get this name"
        raise InputError(f"{header.path}: {words}; rename the column")
