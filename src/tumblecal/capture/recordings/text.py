"""Text of any layout: separator, decimal comma, header line and what is before it are found in the first lines."""

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from tumblecal.capture.corrected_text import TextCells
from tumblecal.capture.protocols.text_layout import separator_of
from tumblecal.capture.recordings.column_names import quantity_of_name
from tumblecal.capture.recordings.damage import Damage
from tumblecal.capture.recordings.options import Asked
from tumblecal.capture.recordings.table import Reader, SourceTable
from tumblecal.capture.recordings.text_header import header_of, refuse_fractions
from tumblecal.data.files import stated
from tumblecal.data.text_cells import numbers_in, row_of
from tumblecal.data.text_layout import TextLayout
from tumblecal.ground.decimal_marks import marks_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import comment_in, is_utf16, opened


if TYPE_CHECKING:
    import polars as pl

_HEAD = 1 << 16
_FEWEST_LINES = 2
_LINES = 200
_TEXT_SHARE = 0.95


def _is_text(head: bytes) -> bool:
    if is_utf16(head):
        return True
    if b"\x00" in head:
        return False
    # As text in Western Europe where it is no UTF-8, which has several bytes a letter.
    text = _decoded(head[:4096].rsplit(b"\n", 1)[0])
    usual = sum(letter in "\t\r\n" or letter.isprintable() for letter in text)
    return usual > _TEXT_SHARE * len(text)


def _layout(path: Path, asked: Asked) -> tuple[TextLayout, dict[str, str]]:
    """The layout by a file's first lines, and what comments state.

    **Raises:** `InputError` when no rows of numbers are among them, the line before them names more or fewer columns than
    they have, or nothing tells a decimal comma from thousands.
    """
    with opened(path) as file:
        head = file.read(_HEAD)
    if len(head) == _HEAD and b"\n" not in head and b"\r" not in head:
        raise InputError(
            f"{path}: its first line is longer than {_HEAD >> 10} kB: no table of samples; give the log itself"
        )
    lines = [_decoded(raw) for raw in _whole_lines(head, to_the_end=len(head) < _HEAD)]
    # What the lines are made of shows in the middle: preambles stand before, a torn line at the end.
    body = [line for line in lines if line.strip() and comment_in(line) is None]
    separator = separator_of(body[len(body) // 2 :][:_LINES])[0]
    rows = [[] if comment_in(line) is not None else row_of(line, separator) for line in lines]
    widths = Counter(len(row) for row in rows if numbers_in(row) >= 3)
    if not widths or max(widths.values()) < min(_FEWEST_LINES, len(body) - 1):
        _refuse_no_rows(path, body, separator)
    width = widths.most_common(1)[0][0]
    rows, width = _with_last_column(lines, rows, separator, width)
    good = [len(row) == width and numbers_in(row) >= 3 for row in rows]
    first = good.index(True)
    told = [row for row, own in zip(rows, good, strict=True) if own]
    names, header = header_of(path, lines[:first], (separator, width), asked)
    if not names:
        refuse_fractions(path, rows[first], first + 1, told, separator)
        names = tuple(str(number + 1) for number in range(width))
    columns = [[row[k] for row in told if row[k]] for k in range(width)]
    numeric = [2 * numbers_in(cells) > len(cells) for cells in columns]
    told += [row for row in _later_rows(path, separator) if len(row) == width]
    comments = stated(lines)
    # A line of two cells before the header states something too; a spreadsheet adds empty ones.
    pairs = [row[:2] for row in rows[:first] if len(row) >= 2 and all(row[:2]) and not any(row[2:])]
    comments |= {key.lower().replace(" ", "_"): value for key, value in pairs}
    marks = _marks(path, names, told, numeric)
    return TextLayout(path, names, separator, marks, header, first + 1), comments


def _with_last_column(
    lines: list[str], rows: list[list[str]], separator: str, width: int
) -> tuple[list[list[str]], int]:
    """The rows with a last cell that is empty here and there, or throughout, where a line above them names its column."""
    of_numbers = [numbers_in(row) >= 3 for row in rows]
    named = {len(row) for row in rows[: of_numbers.index(True)] if any(map(quantity_of_name, row))}
    ended = [
        own and separator != " " and line.rstrip(" ").endswith(separator)
        for line, own in zip(lines, of_numbers, strict=True)
    ]
    short = [end for row, end, own in zip(rows, ended, of_numbers, strict=True) if own and len(row) == width]
    full = width + 1 if width + 1 in named and all(short) else width
    if full not in named:
        return rows, width
    return [[*row, ""] if end and len(row) == full - 1 else row for row, end in zip(rows, ended, strict=True)], full


def _refuse_no_rows(path: Path, body: list[str], separator: str) -> NoReturn:
    named = [line for line in body if any(map(quantity_of_name, row_of(line, separator)))]
    if len(body) == len(named) == 1:
        raise InputError(f"{path}: no rows below the header {body[0][:60]!r}; give the whole recording")
    raise InputError(
        f"{path}: text without rows of three numbers or more, e.g. {''.join(body[:1])[:60]!r}; give the log itself"
    )


def _whole_lines(piece: bytes, *, to_the_end: bool) -> list[bytes]:
    lines = piece.splitlines(keepends=True)
    return lines if to_the_end or len(lines) < 2 else lines[:-1]


def _decoded(raw: bytes) -> str:
    """A line of text; what is no UTF-8 is what a spreadsheet writes in Western Europe."""
    try:
        return raw.decode("utf-8-sig").rstrip("\r\n")
    except UnicodeDecodeError:
        return raw.decode("cp1252", "replace").rstrip("\r\n")


def _later_rows(path: Path, separator: str) -> list[list[str]]:
    """Rows from the middle and the end of a file: numbers beyond a thousand may come late."""
    rows = list[list[str]]()
    with opened(path) as file:
        size = file.seek(0, os.SEEK_END)
        for place in (size // 2, size - _HEAD) if size > 3 * _HEAD else (_HEAD,) if size > _HEAD else ():
            file.seek(place)
            lines = _whole_lines(file.read(_HEAD), to_the_end=False)[1:]
            rows += [row_of(_decoded(line), separator) for line in lines if not line.startswith(b"#")]
    return rows


def _marks(path: Path, names: tuple[str, ...], rows: list[list[str]], numeric: list[bool]) -> tuple[str, ...]:
    """The decimal and thousands marks of each column; empty for one of words.

    **Raises:** `InputError` where they may be either.
    """
    columns = [[row[k] for row in rows] if own else [] for k, own in enumerate(numeric)]
    marks = marks_of(columns)
    for name, cells, own in zip(names, columns, marks, strict=True):
        if own is None:
            _refuse_either(path, name, next(cell for cell in cells if "," in cell or "." in cell))
    return tuple(own if own and number else "" for own, number in zip(marks, numeric, strict=True))


def _refuse_either(path: Path, name: str, cell: str) -> NoReturn:
    with opened(path) as file:
        line = next((number for number, raw in enumerate(file, start=1) if cell in _decoded(raw)), 1)
    mark = "," if "," in cell else "."
    raise InputError(
        f"{path}:line {line}, column {name}: {cell!r} is {cell.replace(mark, '')}, or {cell.replace(mark, '.')}: "
        "nothing tells thousands from decimals; write it without marks between thousands, and with a decimal point"
    )


def _check_late_marks(layout: TextLayout, piece: bytes) -> None:
    """Refuse numbers with marks where those from which the layout was learned had none, and these are no plain decimals."""
    sought = [mark for mark in (b".", b",") if mark in piece and mark != layout.separator.encode()]
    if not sought or {".,", ",."} & set(layout.marks):
        return
    lines = piece.split(b"\n")
    marked = [line for line in lines if any(mark in line for mark in sought)]
    rows = [row_of(_decoded(line), layout.separator) for line in (*marked[:_LINES], *lines[:_LINES])]
    rows = [row for row in rows if len(row) == len(layout.marks)]
    columns = [[row[k] for row in rows] if own else [] for k, own in enumerate(layout.marks)]
    for name, cells, before, own in zip(layout.names, columns, layout.marks, marks_of(columns), strict=True):
        told = [cell for cell in cells if "," in cell or "." in cell]
        if told and (own is None or own[0] != before):
            _refuse_either(layout.path, name, told[0])


def _read(path: Path, asked: Asked, damage: Damage) -> list[SourceTable]:
    layout, comments = _layout(path, asked)

    def pieces(columns: Sequence[str]) -> Iterator["pl.DataFrame"]:
        return layout.frames(
            columns,
            check=lambda piece: _check_late_marks(layout, piece),
            cut=lambda line: damage.report(f"line {line} has no end and may be cut off: left out"),
        )

    return [
        SourceTable(
            *("", layout.names, pieces),
            comments=comments,
            said=layout.words(),
            row_word="line",
            header=layout.header_line,
            text=TextCells(layout, (), layout.decimal) if layout.header_line else None,
            sheet=layout.header_line is not None,
        )
    ]


READER = Reader("text", lambda path, head: _is_text(head), _read, rank=2)
