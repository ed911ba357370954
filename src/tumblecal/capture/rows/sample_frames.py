"""The rows of a recording as columns with units, in pieces; rows without a complete reading are counted."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from tumblecal.capture.columns.clock_text import FORMS
from tumblecal.capture.columns.column_names import LABELS, NUMBERS
from tumblecal.capture.columns.number_range import wrapped_record
from tumblecal.capture.columns.roles import ColumnLayout
from tumblecal.capture.columns.units import FORCE, RATE, reading_of
from tumblecal.capture.rows.contents import Contents
from tumblecal.capture.rows.row_repair import erased_record
from tumblecal.capture.rows.row_runs import FEWEST_ERASED, runs_of
from tumblecal.data.cells import LARGEST_NUMBER
from tumblecal.data.text_layout import ROW
from tumblecal.ground.errors import InputError
from tumblecal.ground.formula_cells import column_from_text
from tumblecal.ground.plain_text import CONTROLS
from tumblecal.ground.text_file import shown


# Columns of the frames of a table that retains its columns: these as a struct, and whether a row has a complete reading.
SOURCE_COLUMNS, WHOLE = "\x00own", "\x00whole"
# With a larger share of unreadable rows, the layout is wrong instead of single lines.
_MOST_UNREADABLE = 0.2
_SHOWN = 5
_DAY_S = 86400


def quantity_names(layout: ColumnLayout) -> dict[str, str]:
    """The columns' names in the table of samples, by quantity."""
    order = ("time", *FORCE, *RATE, "temperature", *NUMBERS, *LABELS)
    names = {"time": "time_s", "temperature": "temperature_degc"}
    units = {role: f"{role}_{column.unit}" for role, column in layout.columns.items() if role in (*FORCE, *RATE)}
    return {role: (names | units).get(role, role) for role in order if role in layout.columns}


@dataclass
class RowCount:
    """Number of rows of some kind in a source, and the first of them, from 1."""

    rows: int = 0
    first: int = 0

    def add(self, before: int, flags: np.ndarray) -> None:
        """Count the rows of a piece that begins after `before` rows."""
        if flags.any():
            self.first = self.first or before + int(np.argmax(flags)) + 1
            self.rows += int(np.count_nonzero(flags))


def frames_of(layout: ColumnLayout, contents: Contents, path: str, more: Sequence[str]) -> Iterator[pl.DataFrame]:
    """The rows in pieces, as for `SampleStream.frames_with`; rows without a complete reading are counted."""
    named = quantity_names(layout)
    wanted = list(dict.fromkeys(name for role in named for name in layout.columns[role].names))
    needed = [named[role] for role in (*FORCE, *RATE, "time", *NUMBERS) if role in named]
    begin = np.nan
    seen = 0
    wrapped = [column for column in layout.columns.values() if column.wrap]
    outside = [c.wrap.concerns(pl.col(c.name).cast(float, strict=False).fill_nan(None)) for c in wrapped if c.wrap]
    out_of_range, erased = RowCount(), RowCount()
    for piece in layout.table.pieces(list(dict.fromkeys([*wanted, *more]))):
        frame = piece.select(
            reading_of(layout.columns[role]).alias(name) if role not in LABELS else
            column_from_text(pl.col(layout.columns[role].name).cast(pl.String).str.replace_all(CONTROLS, "?")).alias(name)
            for role, name in named.items()
        )  # fmt: skip
        if "time_s" in frame.columns and len(frame):
            if np.isnan(begin):
                usual_times = frame["time_s"].filter(frame["time_s"].abs() < LARGEST_NUMBER).drop_nans()
                begin = next(iter(usual_times.head(1)), np.nan)
            frame = frame.with_columns(pl.col("time_s") - begin)
            clock = layout.columns["time"]
            shown_s = begin + clock.offset * (_DAY_S if clock.unit in FORMS else clock.scale)
            contents.begin_s = shown_s + layout.table.zero_s()
        # Numbers too large for any quantity are damage, and would overflow the sums of squares.
        usual = pl.col(needed).abs() < LARGEST_NUMBER
        whole = frame.select(pl.all_horizontal(usual.fill_null(False))).to_series()
        places = piece[ROW].to_numpy() if ROW in piece.columns else np.arange(seen + 1, seen + len(piece) + 1)
        if wrapped:
            out_of_range.add(seen, piece.select(pl.any_horizontal(outside).fill_null(False)).to_series().to_numpy())
        if not whole.all():
            blank = blank_rows(frame.select(named[role] for role in FORCE))
            erased.add(seen, blank)
            rows = np.flatnonzero(~whole.to_numpy() & ~blank)
            contents.unreadable += len(rows)
            if len(rows):
                contents.first_unread = contents.first_unread or _unread_in(layout, piece, frame, int(rows[0]))
            contents.places += (
                places[rows[: _SHOWN - len(contents.places)]].tolist() if len(contents.places) < _SHOWN else []
            )
        seen += len(piece)
        if contents.unreadable > max(_SHOWN, _MOST_UNREADABLE * (seen - erased.rows)):
            raise InputError(
                f"{path}:{layout.table.row_word} {contents.places[0]}: {contents.unreadable} of {seen} rows cannot be read "
                f"as {', '.join(wanted)}; the first {contents.first_unread}. Give the columns of the quantities by --columns"
            )
        contents.add(frame if whole.all() else frame.filter(whole))
        columns = [piece.select(more).to_struct(SOURCE_COLUMNS)] if more else []
        yield frame.with_columns(whole.alias(WHOLE), pl.Series(ROW, places), *columns)
    if not contents.rows:
        raise InputError(f"{path}: no rows")
    if out_of_range.rows:
        contents.damage.add(wrapped_record(wrapped, out_of_range.rows, out_of_range.first))
    if erased.rows:
        contents.damage.add(erased_record(erased.rows, erased.first, "no axis has a number"))


def blank_rows(force: pl.DataFrame) -> np.ndarray:
    """Rows of erased memory: all axes are NaN, or have one number too large for any quantity, in many successive rows."""
    first = pl.col(force.columns[0])
    empty = pl.all_horizontal(pl.all().is_nan()) | pl.all_horizontal(
        (pl.all().abs() >= LARGEST_NUMBER) & (pl.all() == first)
    )
    flags = force.select(empty.fill_null(value=False)).to_series().to_numpy()
    starts, lengths = runs_of(np.append(False, flags[1:] == flags[:-1]))
    return np.repeat(flags[starts] & (lengths >= FEWEST_ERASED), lengths)


def _unread_in(layout: ColumnLayout, piece: pl.DataFrame, frame: pl.DataFrame, row: int) -> str:
    """The cell of a row that is not a number, in words; the cells in general if its text is not stored."""
    for role, name in quantity_names(layout).items():
        value = frame[name].cast(float).to_numpy()[row] if role in (*FORCE, *RATE, "time", *NUMBERS) else 0.0
        if not abs(value) < LARGEST_NUMBER:
            cell = piece[layout.columns[role].name][row]
            return f"for column {layout.columns[role].name}" + ("" if cell is None else f", {shown(cell)}")
    return "for its cells"
