"""The layout of a recording's text, found in its first lines; its middle and its end are searched for further number marks."""

import os
import re
from collections import Counter
from pathlib import Path
from typing import NamedTuple, NoReturn

from tumblecal.capture.columns.column_names import quantity_of_name
from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.capture.recordings.text_header import header_of, refuse_fractions
from tumblecal.data.files import stated
from tumblecal.data.line_form import FORM_SEPARATOR, LineForm, clock_form, has_words, without_clock, word_forms
from tumblecal.data.text_cells import numbers_in, row_of, separator_of
from tumblecal.data.text_layout import SEPARATORS, TextLayout
from tumblecal.ground.counted import counted
from tumblecal.ground.decimal_marks import marks_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import EMPTY_CELLS, comment_in, opened, shown


_HEAD = 1 << 16
_FEWEST_LINES = 2
_LINES = 200
# A line before the rows with a name and a value: // Update Rate: 100.0Hz.
_STATED = re.compile(r"[\W_]*([A-Za-z][\w .\-/()]{0,40}?)\s*[:=]\s*(\S.{0,200}?)\s*")
_MONITOR, _TIMES = "monitor", ("time", "t", "T")


class _Rows(NamedTuple):
    """The rows of a head: names of the columns and their line, the first row (from 0), and the rows of as many cells."""

    names: tuple[str, ...]
    header: int | None
    first: int
    rows: list[list[str]]
    good: list[list[str]]


def sought_layouts(path: Path, options: RecordingOptions) -> tuple[dict[str, TextLayout], dict[str, str]]:
    """The layouts by a file's first lines, one for each kind of line with words around its numbers, and the stated values.

    **Raises:** `InputError` if there are no rows of numbers, the line before them names more or fewer columns than they
    have, or a comma may separate decimals or thousands.
    """
    written = _first_lines(path)
    # Lines from the middle show the layout: preambles come first, and the last line may be torn.
    body = [line for line in written if line.strip() and comment_in(line) is None]
    middle = body[len(body) // 2 :][:_LINES]
    plain = without_clock(middle)
    separator = separator_of(plain or middle)
    form = clock_form(separator) if plain else None
    found = _rows_of(path, written, separator, form, options, len(body))
    if (found is None or (not found.names and _is_labelled(found.good))) and (forms := word_forms(middle)):
        layouts = {name: _layout_of_form(path, written, form) for name, form in forms.items()}
        return layouts, _stated(written, [], min(layout.first_line for layout in layouts.values()) - 1)
    if found is None:
        _refuse_no_rows(path, body, separator)
    names, width = found.names, len(found.good[0])
    if not names:
        refuse_fractions(path, found.good[0], found.first + 1, found.good, separator)
        names = (*(("time",) if form else ()), *(str(k + 1) for k in range(bool(form), width)))
    columns = [[row[k] for row in found.good if row[k]] for k in range(width)]
    numeric = [2 * numbers_in(cells) > len(cells) for cells in columns]
    examined = [*found.good, *(row for row in _later_rows(path, separator, form) if len(row) == width)]
    layout = TextLayout(
        path, names, separator, _marks(path, names, examined, numeric), found.header, found.first + 1, form
    )
    return {"": layout}, _stated(written, [] if form else found.rows, found.first)


def _is_labelled(rows: list[list[str]]) -> bool:
    """Whether numbers have words around them, or names of quantities between them."""
    return has_words(rows) or any(
        len({*cells}) == 1 and quantity_of_name(cells[0]) for cells in zip(*rows, strict=True)
    )


def _first_lines(path: Path) -> list[str]:
    with opened(path) as file:
        head = file.read(_HEAD)
    if len(head) == _HEAD and b"\n" not in head and b"\r" not in head:
        raise InputError(
            f"{path}: its first line is longer than {_HEAD >> 10} kB, so it is not a table of samples; give the original log"
        )
    return [decoded(raw) for raw in _whole_lines(head, to_the_end=len(head) < _HEAD)]


def _rows_of(
    path: Path, written: list[str], separator: str, form: LineForm | None, options: RecordingOptions, count: int
) -> _Rows | None:
    """The rows of three or more numbers among lines, `count` of which are not comments; None if there are too few."""
    lines = [form.line(line) for line in written] if form else written
    rows = [[] if comment_in(line) is not None else row_of(line, separator) for line in lines]
    widths = Counter(len(row) for row in rows if numbers_in(row) >= 3)
    if not widths or max(widths.values()) < min(_FEWEST_LINES, count - 1):
        return None
    rows, width = _with_last_column(lines, rows, separator, widths.most_common(1)[0][0])
    good = [len(row) == width and numbers_in(row) >= 3 for row in rows]
    first = good.index(True)
    above = written[:first]
    if form:
        above = [f"{_MONITOR}{separator}{(without_clock([line]) or [line])[0].lstrip('# ')}" for line in above]
    names, header = header_of(path, above, (separator, width), options)
    if form and names:
        others = {quantity_of_name(name) for name in names[1:]} & {*_TIMES}
        names = (_MONITOR if others else "time", *names[1:])
    return _Rows(names, header, first, rows, [row for row, is_good in zip(rows, good, strict=True) if is_good])


def _layout_of_form(path: Path, written: list[str], form: LineForm) -> TextLayout:
    first = next(k for k, line in enumerate(written) if form.pattern.match(line.encode()))
    cells = form.line(written[first]).split(FORM_SEPARATOR)
    decimal = "," if any("," in cell for cell in cells) else "."
    marks = tuple("" if ":" in cell else decimal for cell in cells)
    return TextLayout(path, form.names, FORM_SEPARATOR, marks, None, first + 1, form)


def _stated(written: list[str], rows: list[list[str]], first: int) -> dict[str, str]:
    """Values that lines state: comments, lines of a name and a value, and lines of two cells before the first row."""
    found = [
        match for line in written[:first] if not line.startswith(("#", '"#')) and (match := _STATED.fullmatch(line))
    ]
    pairs = [(match[1], match[2].strip(EMPTY_CELLS)) for match in found]
    # A spreadsheet adds empty cells.
    pairs += [(row[0], row[1]) for row in rows[:first] if len(row) >= 2 and all(row[:2]) and not any(row[2:])]
    return {key.lower().strip(" :").replace(" ", "_"): value for key, value in pairs} | stated(written)


def _with_last_column(
    lines: list[str], rows: list[list[str]], separator: str, width: int
) -> tuple[list[list[str]], int]:
    """The rows with an additional last cell that is empty in some or all rows, if a line above them names its column."""
    of_numbers = [numbers_in(row) >= 3 for row in rows]
    named = {len(row) for row in rows[: of_numbers.index(True)] if any(map(quantity_of_name, row))}
    ended = [
        numbers and separator != " " and line.rstrip(" ").endswith(separator)
        for line, numbers in zip(lines, of_numbers, strict=True)
    ]
    short = [end for row, end, numbers in zip(rows, ended, of_numbers, strict=True) if numbers and len(row) == width]
    full = width + 1 if width + 1 in named and all(short) else width
    if full not in named:
        return rows, width
    return [[*row, ""] if end and len(row) == full - 1 else row for row, end in zip(rows, ended, strict=True)], full


def _refuse_no_rows(path: Path, body: list[str], separator: str) -> NoReturn:
    named = [line for line in body if any(map(quantity_of_name, row_of(line, separator)))]
    if len(body) == len(named) == 1:
        raise InputError(f"{path}: no rows below the header {body[0][:60]!r}; give the whole recording")
    first = body[0] if body else ""
    if first.lstrip().startswith("<"):
        raise InputError(f"{path}: this is HTML or XML, not a table; export the samples as CSV")
    cells = row_of(first, separator)
    raise InputError(
        f"{path}: text without rows of three or more numbers; its first line {shown(first)} has "
        f"{counted(len(cells), 'cell')} separated by {SEPARATORS[separator]}, {numbers_in(cells)} of them numbers: write the "
        "three accelerations of a sample in one line; for the bytes of a device give --protocol"
    )


def _whole_lines(piece: bytes, *, to_the_end: bool) -> list[bytes]:
    lines = piece.splitlines(keepends=True)
    return lines if to_the_end or len(lines) < 2 else lines[:-1]


def decoded(raw: bytes) -> str:
    """A line of text, as UTF-8 or otherwise in the Western European encoding of spreadsheets."""
    try:
        return raw.decode("utf-8-sig").rstrip("\r\n")
    except UnicodeDecodeError:
        return raw.decode("cp1252", "replace").rstrip("\r\n")


def _later_rows(path: Path, separator: str, form: LineForm | None) -> list[list[str]]:
    """Rows from the middle and the end of a file, since numbers above 1000 may occur late."""
    rows = list[list[str]]()
    with opened(path) as file:
        size = file.seek(0, os.SEEK_END)
        for place in (size // 2, size - _HEAD) if size > 3 * _HEAD else (_HEAD,) if size > _HEAD else ():
            file.seek(place)
            lines = _whole_lines(file.read(_HEAD), to_the_end=False)[1:]
            texts = [decoded(line) for line in lines if not line.startswith(b"#")]
            rows += [row_of(form.line(line) if form else line, separator) for line in texts]
    return rows


def _marks(path: Path, names: tuple[str, ...], rows: list[list[str]], numeric: list[bool]) -> tuple[str, ...]:
    """The decimal and thousands marks of each column; empty for a column of words.

    **Raises:** `InputError` if a mark is ambiguous.
    """
    columns = [[row[k] for row in rows] if is_number else [] for k, is_number in enumerate(numeric)]
    marks = marks_of(columns)
    for name, cells, mark in zip(names, columns, marks, strict=True):
        if mark is None:
            _raise_ambiguous(path, name, next(cell for cell in cells if "," in cell or "." in cell))
    return tuple(mark if mark and number else "" for mark, number in zip(marks, numeric, strict=True))


def _raise_ambiguous(path: Path, name: str, cell: str) -> NoReturn:
    with opened(path) as file:
        line = next((number for number, raw in enumerate(file, start=1) if cell in decoded(raw)), 1)
    mark = "," if "," in cell else "."
    raise InputError(
        f"{path}:line {line}, column {name}: {cell!r} is {cell.replace(mark, '')}, or {cell.replace(mark, '.')}: "
        "the mark may separate thousands or decimals; write no thousands separators, and a decimal point"
    )


def check_late_marks(layout: TextLayout, piece: bytes) -> None:
    """Raise for numbers with marks that the rows of the layout did not have and that are not plain decimals."""
    sought = [mark for mark in (b".", b",") if mark in piece and mark != layout.separator.encode()]
    if not sought or {".,", ",."} & set(layout.marks):
        return
    lines = piece.split(b"\n")
    marked = [line for line in lines if any(mark in line for mark in sought)]
    rows = [row_of(decoded(line), layout.separator) for line in (*marked[:_LINES], *lines[:_LINES])]
    rows = [row for row in rows if len(row) == len(layout.marks)]
    columns = [[row[k] for row in rows] if mark else [] for k, mark in enumerate(layout.marks)]
    for name, cells, before, found in zip(layout.names, columns, layout.marks, marks_of(columns), strict=True):
        marked_cells = [cell for cell in cells if "," in cell or "." in cell]
        if marked_cells and (found is None or found[0] != before):
            _raise_ambiguous(layout.path, name, marked_cells[0])
