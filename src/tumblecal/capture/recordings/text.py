"""Text of any layout: separator, decimal comma, header line and what stands before it are seen in the first lines."""

import os
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from tumblecal.capture.corrected_text import TextCells
from tumblecal.capture.protocols.text_layout import separator_of
from tumblecal.capture.recordings.column_names import quantity_of_name
from tumblecal.capture.recordings.damage import Damage
from tumblecal.capture.recordings.options import Asked
from tumblecal.capture.recordings.table import ROW, Reader, SourceTable
from tumblecal.capture.recordings.text_header import header_of, refuse_fractions
from tumblecal.capture.recordings.text_rows import cells_of, frame_of, numbers_in
from tumblecal.data.files import stated
from tumblecal.ground.decimal_marks import marks_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.last_line import lines_at_end, may_be_cut
from tumblecal.ground.text_file import comment_in, is_utf16, opened, plain_ends


if TYPE_CHECKING:
    import polars as pl

_PIECE = 1 << 23
_HEAD = 1 << 16
_FEWEST_LINES = 2
_LINES = 200
_TEXT_SHARE = 0.95
# A line of these alone holds nothing.
_BLANKS = b" \t\r\n,;"
_LINE_END = re.compile(b"[\r\n]")
_BLANK_FIRST = re.compile(b"\n[" + _BLANKS + b"]")


@dataclass(frozen=True)
class _Layout:
    """How the lines are read: `start` is the place of the first row, `line` its number, `marks` those of each column.

    `header` is the line that names the columns; None where none does.
    """

    separator: str
    columns: tuple[str, ...]
    marks: tuple[str, ...]
    start: int
    line: int
    comments: dict[str, str]
    header: int | None

    def words(self) -> str:
        names = {" ": "spaces", ",": "commas", ";": "semicolons", "\t": "tabs"}
        said = f"text, {len(self.columns)} columns separated by {names[self.separator]}"
        said += ", decimal comma" if any(own[:1] == "," for own in self.marks) else ""
        return said + (f", first row in line {self.line}" if self.line > 1 else ", no header line")


def _is_text(head: bytes) -> bool:
    if is_utf16(head):
        return True
    if b"\x00" in head:
        return False
    # As text in Western Europe where it is no UTF-8, which has several bytes a letter.
    text = _decoded(head[:4096].rsplit(b"\n", 1)[0])
    usual = sum(letter in "\t\r\n" or letter.isprintable() for letter in text)
    return usual > _TEXT_SHARE * len(text)


def _layout(path: Path, asked: Asked) -> _Layout:
    """The layout of a file's first lines.

    **Raises:** `InputError` when no rows of numbers are among them, the line before them names more or fewer columns than
    they have, or nothing tells a decimal comma from thousands.
    """
    with opened(path) as file:
        head = file.read(_HEAD)
    if len(head) == _HEAD and not _LINE_END.search(head):
        raise InputError(
            f"{path}: its first line is longer than {_HEAD >> 10} kB: no table of samples; give the log itself"
        )
    raw_lines = _whole_lines(head, to_the_end=len(head) < _HEAD)
    lines = [_decoded(raw) for raw in raw_lines]
    # What the lines are made of shows in the middle: preambles stand before, a torn line at the end.
    body = [line for line in lines if line.strip() and comment_in(line) is None]
    separator = separator_of(body[len(body) // 2 :][:_LINES])[0]
    rows = [[] if comment_in(line) is not None else cells_of(line, separator) for line in lines]
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
    return _Layout(separator, names, marks, sum(map(len, raw_lines[:first])), first + 1, comments, header)


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
    named = [line for line in body if any(map(quantity_of_name, cells_of(line, separator)))]
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
            rows += [cells_of(_decoded(line), separator) for line in lines if not line.startswith(b"#")]
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


def _check_late_marks(path: Path, piece: bytes, layout: _Layout) -> None:
    """Refuse numbers with marks where those from which the layout was learned had none, and these are no plain decimals."""
    sought = [mark for mark in (b".", b",") if mark in piece and mark != layout.separator.encode()]
    if not sought or {".,", ",."} & set(layout.marks):
        return
    lines = piece.split(b"\n")
    marked = [line for line in lines if any(mark in line for mark in sought)]
    rows = [cells_of(_decoded(line), layout.separator) for line in (*marked[:_LINES], *lines[:_LINES])]
    rows = [row for row in rows if len(row) == len(layout.marks)]
    columns = [[row[k] for row in rows] if own else [] for k, own in enumerate(layout.marks)]
    for name, cells, before, own in zip(layout.columns, columns, layout.marks, marks_of(columns), strict=True):
        told = [cell for cell in cells if "," in cell or "." in cell]
        if told and (own is None or own[0] != before):
            _refuse_either(path, name, told[0])


def _pieces_of(path: Path, start: int) -> Iterator[bytes]:
    """The lines from a place on, some megabytes at a time, each piece of whole lines."""
    with opened(path) as file:
        file.seek(start)
        rest = b""
        while piece := file.read(_PIECE):
            piece = rest + piece
            cut = piece.rfind(b"\n") + 1
            if not cut:
                # Of old systems returns alone end the lines; one at the end may be half of an end.
                cut = piece.rfind(b"\r", 0, -1) + 1
            rest = piece[cut:]
            yield plain_ends(piece[:cut])
        yield plain_ends(rest)


def _is_cut(path: Path, layout: _Layout) -> bool:
    """Whether the last line, which has no end, is a row and not the whole of one for sure."""
    lines, _ = lines_at_end(path)
    if not lines:  # of a line that long nobody knows what it is
        return True
    if not lines[-1].strip(_BLANKS.decode()) or lines[-1].startswith("#"):
        return False
    rows = [cells_of(line, layout.separator) for line in lines]
    # A last column that is empty throughout is none of the layout, but its separators are there.
    others = [row[-1] for row in rows[:-1] if len(row) == len(rows[-1])]
    usual = bool(others) or len(rows[-1]) == len(layout.columns)
    return not usual or may_be_cut(rows[-1][-1], others, digits="most")


def _rows_of(piece: bytes) -> list[bool]:
    """Which lines are meant as rows: not blank, no comment."""
    return [bool(line.strip(_BLANKS)) and not line.startswith(b"#") for line in piece.removesuffix(b"\n").split(b"\n")]


def _read(path: Path, asked: Asked, damage: Damage) -> list[SourceTable]:
    layout = _layout(path, asked)

    def pieces(columns: Sequence[str]) -> Iterator["pl.DataFrame"]:
        import polars as pl

        line = layout.line
        for piece in _pieces_of(path, layout.start):
            if not piece:
                continue
            cut = not piece.endswith(b"\n") and _is_cut(path, layout)
            _check_late_marks(path, piece, layout)
            frame = frame_of(piece, layout.separator, layout.marks)
            places = pl.Series(ROW, range(line, line + len(frame)))
            line += len(frame)
            cells = [
                pl.when(pl.col("more").is_null()).then(pl.col(f"c{layout.columns.index(name)}")).alias(name)
                for name in columns
            ]
            frame = frame.select(cells)
            if cut:
                damage.report(f"line {line - 1} has no end and may be cut off: left out")
                frame = frame.with_columns(pl.all().slice(0, len(frame) - 1).extend_constant(None, 1))
            frame = frame.with_columns(places)
            # Told by its characters, which is quicker than looking at each line.
            passed_over = b"#" in piece or piece[:1] in _BLANKS or _BLANK_FIRST.search(piece)
            yield frame.filter(pl.Series(_rows_of(piece))) if passed_over else frame

    decimal = "," if any(own[:1] == "," for own in layout.marks) else "."
    text = layout.header and TextCells((), layout.separator, decimal, layout.header, layout.line)
    return [
        SourceTable(
            *("", layout.columns, pieces),
            comments=layout.comments,
            said=layout.words(),
            row_word="line",
            header=layout.header,
            text=text or None,
            sheet=layout.header is not None,
        )
    ]


READER = Reader("text", lambda path, head: _is_text(head), _read, rank=2)
