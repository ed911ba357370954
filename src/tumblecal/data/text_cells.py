"""Cells of lines of text: line ends, comments, quotation marks, separators; in pieces of some megabytes."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.ground.decimal_marks import NUMBER
from tumblecal.ground.text_file import EMPTY_CELLS, opened, plain_ends


if TYPE_CHECKING:
    import polars as pl

_PIECE = 1 << 23
# Placeholders for line ends and other characters within quotation marks, until the cells are separated.
QUOTED_END = "\x03"
_QUOTED_SEPARATOR, _QUOTED_MARK = "\x02", "\x04"
# Largest number of lines of a cell in quotation marks; if there are more, a mark is missing.
_MOST_LINES = 10
_BLANKS = EMPTY_CELLS.encode()
_BLANK_FIRST = re.compile(b"\n[" + _BLANKS + b"]")
# Comments as in `ground.text_file.comment_in`.
_COMMENT = re.compile(rb'^(?:#.*|"#(?:[^"\n]|"")*"[,;| \t]*)$', re.MULTILINE)


def separator_of(lines: Sequence[str]) -> str:
    """The separator that gives the most numbers: one that does not occur in numbers, otherwise commas or blanks."""
    joined = "\n".join(lines)
    for separator in (";", "\t", "|"):
        if separator in joined:
            return separator
    if "," not in joined:
        return " "
    padded = any(re.search(r"(^|\s),|,(\s|$)", line) for line in lines)
    by_space = sum(numbers_in(line.split()) >= 3 for line in lines)
    return " " if not padded and 2 * by_space > len(lines) else ","


def cells_of(line: str, separator: str) -> list[str]:
    """The cells of a line, without leading and trailing blanks."""
    line = unquoted(line.encode(), separator).decode().replace('"', "")
    words = line.split() if separator == " " else [word.strip() for word in line.split(separator)]
    return [restored(word, separator) for word in words]


def row_of(line: str, separator: str) -> list[str]:
    """The cells of a line, without the empty one after a separator at its end."""
    cells = cells_of(line, separator)
    return cells[:-1] if cells and not cells[-1] else cells


def numbers_in(row: Sequence[str]) -> int:
    """Number of cells that are numbers."""
    return sum(bool(NUMBER.fullmatch(cell)) for cell in row)


def pieces_of(path: Path, first_line: int = 1) -> Iterator[bytes]:
    """The lines of a text from `first_line` on, in pieces of complete lines that end in line feeds."""
    skipped = first_line - 1
    with opened(path) as file:
        while piece := file.read(_PIECE) + file.readline():
            piece = plain_ends(piece)
            while skipped and piece:
                piece, skipped = piece.partition(b"\n")[2], skipped - 1
            if piece:
                yield piece


def with_whole_cells(pieces: Iterator[bytes]) -> Iterator[bytes]:
    """Pieces in which no quoted cell is cut: the line of an open quotation mark begins the next piece."""
    rest = b""
    for piece in pieces:
        piece, rest = rest + piece, b""
        if piece.count(b'"') % 2:
            start = piece.rfind(b"\n", 0, piece.rfind(b'"')) + 1
            if piece.count(b"\n", start) < _MOST_LINES:
                piece, rest = piece[:start], piece[start:]
        if piece:
            yield piece
    if rest:
        yield rest


def unquoted(text: bytes, separator: str) -> bytes:
    """Text with the contents of quoted cells in place of them, with placeholders for separators, line ends and marks.

    Quotation marks that remain do not enclose a cell.
    """
    if b'"' not in text:
        return text
    between = b" \t" if separator == " " else re.escape(separator.encode())
    cell = rb'(?<![^\n%b]) *"((?:[^"\n]|"")*(?:\n(?:[^"\n]|"")*){0,%d})" *(?=[\n%b]|\Z)'
    marks = {b'""': _QUOTED_MARK, separator.encode(): _QUOTED_SEPARATOR, b"\n": QUOTED_END}

    def content(quoted: re.Match[bytes]) -> bytes:
        found = quoted[1]
        for mark, placeholder in marks.items():
            found = found.replace(mark, placeholder.encode())
        return found

    return re.sub(cell % (between, _MOST_LINES - 1, between), content, text)


def restored(cell: str, separator: str) -> str:
    """A cell with the characters that were within quotation marks."""
    for placeholder, text in _placeholders(separator):
        cell = cell.replace(placeholder, text)
    return cell


def _placeholders(separator: str) -> tuple[tuple[str, str], ...]:
    return (_QUOTED_SEPARATOR, separator), (QUOTED_END, "\n"), (_QUOTED_MARK, '"')


def without_comments(piece: bytes) -> bytes:
    """Lines with blank ones in place of comments."""
    return _COMMENT.sub(b"", piece) if b"#" in piece else piece


def row_lines(piece: bytes) -> list[bool] | None:
    """Which lines of a piece are not blank; None if all are, according to their first characters."""
    if piece[:1] not in _BLANKS and not _BLANK_FIRST.search(piece):
        return None
    return [bool(line.strip(_BLANKS)) for line in piece.removesuffix(b"\n").split(b"\n")]


def frame_of(piece: bytes, separator: str, numeric: Sequence[bool]) -> "pl.DataFrame":
    """The lines of a piece: columns c0, c1 ... and `more`, which is null unless a line has too many cells.

    **Arguments:**

    - `piece`: lines after `unquoted`. `numeric`: whether the cells of each column become numbers.
    """
    import polars as pl

    between, words = separator.encode(), not all(numeric)
    # One character between cells, no blanks around them, no plus signs, and no separator at the end of a line.
    piece = piece.replace(b'"', b"")
    if separator == " ":
        if b"  " in piece or b"\t" in piece or b"\n " in piece or piece[:1] == b" ":
            piece = re.sub(rb"(?m)^ ", b"", re.sub(rb"[ \t]+", b" ", piece))
    elif b" " in piece:
        padded = rb"(?m)^ +| *(" + re.escape(between) + rb") *"
        piece = re.sub(padded, rb"\1", piece) if words else piece.replace(b" ", b"")
    piece = piece.replace(between + b"\n", b"\n")
    piece = piece if words else piece.replace(b"+", b"")
    # A first line with one cell too many, so that such lines are detected.
    full = separator.join(["0"] * (len(numeric) + 1)).encode() + b"\n"
    schema = {f"c{k}": pl.Float64 if number else pl.String for k, number in enumerate(numeric)}
    frame = pl.read_csv(
        full + piece,
        has_header=False,
        schema=schema | {"more": pl.String},
        separator=separator,
        truncate_ragged_lines=True,
        ignore_errors=True,
        encoding="utf8-lossy",
        quote_char=None,
    ).slice(1)
    for placeholder, text in _placeholders(separator):
        if placeholder.encode() in piece:
            frame = frame.with_columns(pl.col(pl.String).str.replace_all(placeholder, text, literal=True))
    return frame
