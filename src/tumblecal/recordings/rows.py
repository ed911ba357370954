"""The rows of a recording as columns in SI units, in pieces."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import polars as pl

from tumblecal.data.cells import LARGEST_NUMBER
from tumblecal.data.column_names import FORCE, LABELS, NUMBERS, QUANTITIES, RATE
from tumblecal.data.text_layout import ROW
from tumblecal.ground.errors import InputError
from tumblecal.ground.formula_cells import column_from_text
from tumblecal.ground.plain_text import CONTROLS
from tumblecal.ground.text_file import shown
from tumblecal.recordings.columns import Column, Layout
from tumblecal.recordings.sizes import signed_words
from tumblecal.recordings.table import Table


# Whether a row has a complete reading; the columns of the source.
WHOLE, SOURCE_COLUMNS = "\x00whole", "\x00source"
# With a larger share of unreadable rows, the layout is wrong instead of single lines.
_MOST_UNREADABLE, _SHOWN = 0.2, 5
_CHECKED_ROWS = 2000


@dataclass
class Unread:
    """Rows without a complete reading: their number, the places of the first, and why the first cannot be read."""

    rows: int = 0
    places: list[int] = field(default_factory=list)
    why: str = ""


def names_of(layout: Layout) -> dict[str, str]:
    """Columns of the samples by quantity: `time_s, ax_g .., gx_dps .., temperature_degc, position ..`."""
    units = {role: f"{role}_{column.unit}" for role, column in layout.columns.items() if role in (*FORCE, *RATE)}
    names = {"time": "time_s", "temperature": "temperature_degc"} | units
    order = ("time", *(role for role in QUANTITIES if role != "time"))
    return {role: names.get(role, role) for role in order if role in layout.columns}


def sample_frames(
    table: Table, layout: Layout, path: str, unread: Unread, begin: list[float], more: Sequence[str] = ()
) -> Iterator[pl.DataFrame]:
    """All rows in pieces, with the columns of `names_of`, `WHOLE`, `ROW` and, for `more`, `SOURCE_COLUMNS`.

    **Arguments:**

    - `unread`: counts rows without a complete reading. `begin`: gets the first time, s, which becomes zero.
    - `more`: columns of the source to retain as text or numbers.

    **Raises:** `InputError` if there are no rows, if many cannot be read, or if negative numbers are written as unsigned ones.
    """
    named, columns = names_of(layout), layout.columns
    wanted = [name for column in columns.values() for name in (column.name, column.whole) if name]
    needed = [role for role in (*FORCE, *RATE, "time", *NUMBERS) if role in named]
    # Numbers too large for any quantity are damage, and would overflow the sums of squares.
    usual = [
        pl.col(named[role]).abs().fill_nan(np.inf) < (np.inf if role == "time" else LARGEST_NUMBER) for role in needed
    ]
    force = [columns[axis] for axis in FORCE]
    seen = 0
    for piece in table.pieces(list(dict.fromkeys([*wanted, *more]))):
        frame = piece.select(
            (_label(columns[role].name) if role in LABELS else columns[role].reading()).alias(name)
            for role, name in named.items()
        )
        checked = piece.gather_every(1 + len(piece) // _CHECKED_ROWS)
        numbers = np.stack([Column(axis.name).numbers(checked) for axis in force], axis=1)
        if not force[0].bits and (words := signed_words([axis.name for axis in force], numbers)):
            raise InputError(f"{path}: {words}")
        if "time_s" in frame.columns:
            times = frame["time_s"].drop_nans()
            begin += [] if begin else times.filter(times.abs() < LARGEST_NUMBER).head(1).to_list()
            frame = frame.with_columns(pl.col("time_s") - (begin[0] if begin else np.nan))
        whole = frame.select(pl.all_horizontal(usual).fill_null(value=False)).to_series()
        places = piece[ROW] if ROW in piece.columns else pl.Series(np.arange(seen + 1, seen + len(piece) + 1))
        seen += len(piece)
        if not whole.all():
            lost = (~whole).arg_true()
            cells = piece.select(columns[role].name for role in needed).row(lost[0])
            unread.why = unread.why or f"has {shown(', '.join(map(str, cells)))}"
            unread.places += places.gather(lost[: _SHOWN - len(unread.places)]).to_list()
            unread.rows += len(lost)
            # Rows of erased memory have no number at all.
            empty = pl.all_horizontal(
                pl.col(named[axis]).is_nan() | (pl.col(named[axis]).abs() >= LARGEST_NUMBER) for axis in FORCE
            )
            blank = frame.filter(~whole).select(empty.fill_null(value=False).mean()).item() > 1 - _MOST_UNREADABLE
            if unread.rows > max(_SHOWN, _MOST_UNREADABLE * seen) and not blank:
                raise InputError(
                    f"{path}:{table.row_word} {unread.places[0]}: {unread.rows} of {seen} rows cannot be read as "
                    f"{', '.join(wanted)}; the first {unread.why}. Give the columns of the quantities by --columns"
                )
        source = [piece.select(more).to_struct(SOURCE_COLUMNS)] if more else []
        yield frame.with_columns(whole.alias(WHOLE), places.alias(ROW), *source)
    if unread.rows == seen:
        raise InputError(f"{path}: no rows with a complete reading{f'; the first {unread.why}' if seen else ''}")


def _label(name: str) -> pl.Expr:
    return column_from_text(pl.col(name).cast(pl.String).str.replace_all(CONTROLS, "?"))
