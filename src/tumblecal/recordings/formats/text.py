"""Text: rows between separators, or lines with words around their numbers; what the lines before the rows state."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NoReturn

import polars as pl

from tumblecal.data.column_names import role_of
from tumblecal.data.files import stated
from tumblecal.data.line_form import FORM_SEPARATOR, clock_form, without_clock, word_forms
from tumblecal.data.text_cells import numbers_in, row_of, separator_of
from tumblecal.data.text_layout import SEPARATORS, TextLayout
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import comment_in, is_utf16, opened, shown
from tumblecal.recordings.formats.text_layouts import (
    are_labelled,
    check_marks,
    header_of,
    kinds_of,
    layout_of_form,
    layout_of_kind,
    row_width,
    statements_in,
)
from tumblecal.recordings.table import Reader, Source, Table


_HEAD, _LINES, _FEWEST_LINES, _TEXT_SHARE = 1 << 16, 200, 2, 0.95
_ROLES = {"SampleTimeFine": "time_100us"}


def _is_text(path: Path, head: bytes) -> bool:
    if is_utf16(head):
        return True
    text = decoded(head[:4096].rsplit(b"\n", 1)[0])
    usual = sum(letter in "\t\r\n" or letter.isprintable() for letter in text)
    return b"\x00" not in head and usual > _TEXT_SHARE * len(text)


def decoded(raw: bytes) -> str:
    """A line of text, as UTF-8 or otherwise in the Western European encoding of spreadsheets."""
    try:
        return raw.decode("utf-8-sig").rstrip("\r\n")
    except UnicodeDecodeError:
        return raw.decode("cp1252", "replace").rstrip("\r\n")


def _read(source: Source) -> list[Table]:
    """The tables of a text: one, or one for each kind of row.

    **Raises:** `InputError` if there are no rows of three numbers, or the header does not fit the rows.
    """
    path = source.path
    written = _first_lines(path)
    body = [line for line in written if line.strip() and comment_in(line) is None]
    # Lines from the middle show the layout: preambles come first, and the last line may be torn.
    middle = body[len(body) // 2 :][:_LINES]
    plain = without_clock(middle)
    separator = separator_of(plain or middle)
    clock = clock_form(separator) if plain else None
    if kinds := kinds_of(middle, separator):
        return [
            text_table(source, *layout_of_kind(path, written, kind, separator), name=kind.lstrip("$")) for kind in kinds
        ]
    lines = [clock.line(line) for line in written] if clock else written
    rows = [[] if comment_in(line) is not None else row_of(line, separator) for line in lines]
    widths = Counter(len(row) for row in rows if numbers_in(row) >= 3)
    found = bool(widths) and max(widths.values()) >= min(_FEWEST_LINES, len(body) - 1)
    width = row_width(lines, rows, separator, widths.most_common(1)[0][0]) if found else 0
    first = (
        next((k for k, row in enumerate(rows) if len(row) in (width, width - 1) and numbers_in(row) >= 3), len(rows))
        if found
        else 0
    )
    names, header = header_of(source, written[:first], separator, width, clock is not None) if found else ((), None)
    if not found and (table := _of_axes(source, rows, separator)):
        return [table]
    if (not found or (header is None and not clock and are_labelled(rows, width))) and (forms := word_forms(middle)):
        many = len(forms) > 1
        return [
            text_table(source, *layout_of_form(path, written, form), name=name if many else "")
            for name, form in forms.items()
        ]
    if not found:
        _refuse(path, body, separator)
    layout = TextLayout(path, names, separator, ("",) * width, header, first + 1, clock)
    check_marks(path, [row for row in rows if len(row) == width and numbers_in(row) >= 3], first, separator)
    return [text_table(source, layout, statements_in(written[:first], separator) | stated(written))]


def _first_lines(path: Path) -> list[str]:
    with opened(path) as file:
        head = file.read(_HEAD)
    lines = head.splitlines(keepends=True)
    if len(head) == _HEAD and len(lines) < 2:
        raise InputError(
            f"{path}: its first line is longer than {_HEAD >> 10} kB, so it is not a table of samples; give the original log"
        )
    return [decoded(raw) for raw in (lines if len(head) < _HEAD else lines[:-1])]


def text_table(
    source: Source, layout: TextLayout, statements: Mapping[str, str], name: str = "", roles: Mapping[str, str] = _ROLES
) -> Table:
    """The rows of a text with this layout; all cells are text. `roles`: quantities of some columns."""

    def pieces(columns: Sequence[str]) -> Iterator[pl.DataFrame]:
        return layout.frames(
            columns, cut=lambda line: source.damage.report(f"line {line} has no end and may be truncated: left out")
        )

    decimal = source.options.decimal
    if decimal not in ("", "comma", "point", ",", "."):
        raise InputError(f"--decimal {decimal}: write point or comma")
    with_commas = decimal in ("comma", ",") or (
        not decimal and layout.separator in ";\t|" + FORM_SEPARATOR and _has_commas(layout)
    )
    return Table(
        *(name, layout.names, pieces),
        stated=statements,
        words=layout.words() + (", decimal comma" if with_commas else ""),
        row_word="line",
        header=layout.header_line,
        sheet=layout.header_line is not None,
        roles={name: role for name, role in roles.items() if name in layout.names},
        decimal="," if with_commas else ".",
    )


def _has_commas(layout: TextLayout) -> bool:
    """Whether cells have numbers with commas."""
    frame = next(layout.frames(layout.names)).head(_LINES)
    return any(frame[name].str.contains(r"^[+-]?\d*,\d+(?:[eE][+-]?\d+)?$").any() for name in layout.names)


def _of_axes(source: Source, rows: Sequence[list[str]], separator: str) -> Table | None:
    """A table with a row for each axis, as one with a column for each; None for other text."""
    widths = Counter(map(len, rows))
    width = widths.most_common(1)[0][0] if widths else 0
    good = [row for row in rows if len(row) == width]
    axes = [k for k in range(width) if {row[k].lower() for row in good[1:]} == {"x", "y", "z"}]
    values = [k for k in range(width) if len(good) > 1 and numbers_in([row[k] for row in good[1:]]) == len(good) - 1]
    if len(axes) != 1 or not values or numbers_in(good[0]):
        return None
    layout = TextLayout(source.path, tuple(good[0]), separator, ("",) * width, 1, 2)
    axis, value = good[0][axes[0]], good[0][values[-1]]
    keys = [name for name in good[0] if name not in (axis, value)]
    frame = pl.concat(layout.frames(good[0])).with_columns(pl.col(axis).str.to_lowercase())
    wide = frame.pivot(on=axis, index=keys, values=value, aggregate_function="first")
    sensor = " ".join(str(frame[name][0]) for name in keys if frame[name].n_unique() == 1)
    wide = wide.rename({letter: f"{sensor} {letter}".strip() for letter in "xyz"})
    return Table(
        "",
        tuple(wide.columns),
        lambda columns: iter([wide.select(columns)]),
        len(wide),
        words="text, a row for each axis",
    )


def _refuse(path: Path, body: Sequence[str], separator: str) -> NoReturn:
    first = body[0] if body else ""
    cells = row_of(first, separator)
    if len(body) == 1 and any(role_of(cell)[0] for cell in cells):
        raise InputError(f"{path}: no rows below the header {first[:60]!r}; give the whole recording")
    if first.lstrip().startswith("<"):
        raise InputError(f"{path}: this is HTML or XML, not a table; export the samples as CSV")
    raise InputError(
        f"{path}: text without rows of three or more numbers; its first line {shown(first)} has "
        f"{counted(len(cells), 'cell')} separated by {SEPARATORS[separator]}, {numbers_in(cells)} of them numbers: write the "
        "three accelerations of a sample in one line; for the bytes of a device give --protocol"
    )


READER = Reader("text", _is_text, _read, rank=2)
