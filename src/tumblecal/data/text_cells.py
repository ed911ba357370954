"""Cells of lines of text: line ends, comments, quotation marks, separators; in pieces of some megabytes."""

import csv
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.ground.decimal_marks import NUMBER
from tumblecal.ground.text_file import EMPTY_CELLS, comment_in, is_blank, opened, plain_ends


if TYPE_CHECKING:
    import polars as pl

_PIECE = 1 << 23
# Placeholders for separators and line ends within quotation marks, until the cells are separated.
QUOTED_SEPARATOR, QUOTED_END = "\x02", "\x03"
# Largest number of lines of a cell in quotation marks; if there are more, a mark is missing.
_MOST_LINES = 10
_BLANKS = EMPTY_CELLS.encode()
_BLANK_FIRST = re.compile(b"\n[" + _BLANKS + b"]")


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
    line = unquoted(line.encode(), separator.encode()).decode()
    words = line.split() if separator == " " else [word.strip() for word in line.split(separator)]
    return [word.replace(QUOTED_SEPARATOR, separator) for word in words]


def row_of(line: str, separator: str) -> list[str]:
    """The cells of a line, without the empty one after a separator at its end."""
    cells = cells_of(line, separator)
    return cells[:-1] if cells and not cells[-1] else cells


def strict_cells(line: str, separator: str) -> list[str]:
    """The cells of a line or of a few lines.

    **Raises:** `csv.Error` for wrong quotation marks.
    """
    return next(csv.reader(line.splitlines(keepends=True), strict=True, delimiter=separator, skipinitialspace=True), [])


def numbers_in(row: Sequence[str]) -> int:
    """Number of cells that are numbers."""
    return sum(bool(NUMBER.fullmatch(cell)) for cell in row)


def is_row(line: bytes) -> bool:
    """Whether a line is a row: neither blank nor a comment."""
    if line[:1] not in b'#" \t,;|\r':
        return True
    text = line.decode("utf-8", "replace")
    return not is_blank(text) and comment_in(text) is None


def row_lines(piece: bytes) -> list[bool] | None:
    """Which lines of a piece are rows; None if all are, according to their first characters."""
    if b"#" not in piece and piece[:1] not in _BLANKS and not _BLANK_FIRST.search(piece):
        return None
    return [is_row(line) for line in piece.removesuffix(b"\n").split(b"\n")]


def pieces_of(path: Path, first_line: int = 1) -> Iterator[bytes]:
    """The lines of a text from `first_line` on, in pieces of complete lines that end in line feeds."""
    with opened(path) as file:
        rest, skipped = b"", first_line - 1
        while piece := file.read(_PIECE):
            piece = rest + piece
            cut = piece.rfind(b"\n") + 1
            if not cut:
                # Old systems end lines with a return only; a return at the end of the piece may be half of a line end.
                cut = piece.rfind(b"\r", 0, -1) + 1
            rest = piece[cut:]
            piece, skipped = _without(plain_ends(piece[:cut]), skipped)
            if piece:
                yield piece
        piece, _ = _without(plain_ends(rest), skipped)
        if piece:
            yield piece


def _without(piece: bytes, lines: int) -> tuple[bytes, int]:
    """A piece without its first lines, and the number of lines to remove from the next pieces."""
    while lines and piece:
        end = piece.find(b"\n") + 1 or len(piece)
        piece, lines = piece[end:], lines - 1
    return piece, lines


def joined_pieces(pieces: Iterator[bytes], separator: str, width: int) -> Iterator[bytes]:
    """Pieces in which the lines of a quoted cell are joined in its first line, and its other lines are blank."""
    rest = b""
    for piece in pieces:
        if b'"' not in piece and not rest:
            yield piece
            continue
        lines = (rest + piece).split(b"\n")
        # The text after the last line feed is empty, or a line without an end.
        begun = _join(lines, len(lines) - 1, separator, width)
        piece, rest = b"\n".join([*lines[:begun], b""]), b"\n".join(lines[begun:])
        if piece:
            yield piece
    if rest:
        lines = rest.split(b"\n")
        _join(lines, len(lines), separator, width)
        yield b"\n".join(lines)


def _join(lines: list[bytes], count: int, separator: str, width: int) -> int:
    """Join the first lines in place if a cell has several; returns the line from which a cell may continue after them."""
    spans, begun = spans_of(lines[:count], separator, width)
    for start, end in spans:
        lines[start:end] = [QUOTED_END.encode().join(lines[start:end]), *[b""] * (end - start - 1)]
    return begun


def spans_of(lines: Sequence[bytes], separator: str, width: int) -> tuple[list[tuple[int, int]], int]:
    """The ranges of lines that are one row of `width` cells, because a quoted cell has several lines.

    **Returns:** the ranges, and the line from which a cell may continue after these lines; an unclosed mark is ignored.
    """
    spans, until = list[tuple[int, int]](), 0
    for k, line in enumerate(lines):
        if k < until or line.count(b'"') % 2 == 0 or line[:1] == b"#":
            continue
        for end in range(k + 2, k + 1 + _MOST_LINES):
            if end > len(lines):
                return spans, k
            joined = b"\n".join(lines[k:end])
            if joined.count(b'"') % 2 == 0:
                if _is_whole(joined, separator, width):
                    spans.append((k, end))
                    until = end
                break
    return spans, len(lines)


def _is_whole(lines: bytes, separator: str, width: int) -> bool:
    """Whether lines are one row of strict CSV."""
    try:
        cells = strict_cells(lines.decode("utf-8", "replace"), separator)
    except csv.Error:
        return False
    return len(cells) == width or (len(cells) == width + 1 and not cells[-1])


def unquoted(text: bytes, separator: bytes) -> bytes:
    """Text without quotation marks: quoted separators become `QUOTED_SEPARATOR`, and a doubled mark becomes one.

    All marks of a line with an odd number are removed; otherwise it would include the following lines.
    """
    if b'"' not in text:
        return text
    parts = text.split(b'"')
    if len(parts) % 2 == 0 or b"\n" in b"".join(parts[1::2]):
        lines = text.split(b"\n")
        return b"\n".join(
            line.replace(b'"', b"") if line.count(b'"') % 2 else unquoted(line, separator) for line in lines
        )
    if separator in b"".join(parts[1::2]):
        parts[1::2] = [part.replace(separator, QUOTED_SEPARATOR.encode()) for part in parts[1::2]]
    parts[2:-1:2] = [part or b'"' for part in parts[2:-1:2]]
    return b"".join(parts)


def frame_of(piece: bytes, separator: str, numeric: Sequence[bool]) -> "pl.DataFrame":
    """The rows of complete lines: columns c0, c1 ... and `more`, which is null unless a line has too many cells.

    **Arguments:**

    - `piece`: lines that end in line feeds. `numeric`: whether the cells of each column become numbers.
    """
    import polars as pl

    piece = _parted(unquoted(piece, separator.encode()), separator, words=not all(numeric))
    # A line with one cell too many, so that such lines are detected.
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
    for placeholder, text in ((QUOTED_SEPARATOR, separator), (QUOTED_END, "\n")):
        if placeholder.encode() in piece:
            frame = frame.with_columns(pl.col(pl.String).str.replace_all(placeholder, text, literal=True))
    return frame


def _parted(piece: bytes, separator: str, *, words: bool) -> bytes:
    """The lines in the form for polars: one character between cells, no plus signs."""
    between = separator.encode()
    if between == b" ":
        if b"  " in piece or b"\t" in piece or b"\n " in piece or piece[:1] == b" ":
            piece = re.sub(rb"(?m)^ ", b"", re.sub(rb"[ \t]+", b" ", piece))
    elif b" " in piece:
        piece = (
            re.sub(rb"(?m)^ +| *(" + re.escape(between) + rb") *", rb"\1", piece) if words else piece.replace(b" ", b"")
        )
    # A separator at the end of a line does not begin a cell.
    piece = piece.replace(between + b"\n", b"\n")
    return piece if words else piece.replace(b"+", b"")
