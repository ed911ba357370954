"""Lines of text as cells: ends of lines, comments, quotation marks, separators; some megabytes of a file at a time."""

import csv
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.ground.decimal_marks import NUMBER, number_of
from tumblecal.ground.text_file import EMPTY_CELLS, comment_in, is_blank, opened, plain_ends


if TYPE_CHECKING:
    import polars as pl

_PIECE = 1 << 23
# Stand for separators and ends of lines within quotation marks until the cells are parted.
HELD, HELD_END = "\x02", "\x03"
# A cell in quotation marks covers so many lines at most; beyond, a mark is missing.
_MOST_LINES = 10
_BLANKS = EMPTY_CELLS.encode()
_BLANK_FIRST = re.compile(b"\n[" + _BLANKS + b"]")


def separator_of(lines: Sequence[str]) -> str:
    """The separator that gives the most numbers: one that is in no number, otherwise commas or blanks."""
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
    """The cells of a line, without the blanks around them."""
    line = unquoted(line.encode(), separator.encode()).decode()
    words = line.split() if separator == " " else [word.strip() for word in line.split(separator)]
    return [word.replace(HELD, separator) for word in words]


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
    """How many cells are numbers."""
    return sum(bool(NUMBER.fullmatch(cell)) for cell in row)


def is_row(line: bytes) -> bool:
    """Whether a line is meant as a row: neither blank nor a comment."""
    if line[:1] not in b'#" \t,;|\r':
        return True
    text = line.decode("utf-8", "replace")
    return not is_blank(text) and comment_in(text) is None


def row_lines(piece: bytes) -> list[bool] | None:
    """Which lines of a piece are rows; None if all are, which their first letters show."""
    if b"#" not in piece and piece[:1] not in _BLANKS and not _BLANK_FIRST.search(piece):
        return None
    return [is_row(line) for line in piece.removesuffix(b"\n").split(b"\n")]


def pieces_of(path: Path, first_line: int = 1) -> Iterator[bytes]:
    """The lines of a text from one on, in pieces of whole lines that end in line feeds alone."""
    with opened(path) as file:
        rest, skipped = b"", first_line - 1
        while piece := file.read(_PIECE):
            piece = rest + piece
            cut = piece.rfind(b"\n") + 1
            if not cut:
                # On old systems returns alone end the lines; one at the end may be half of an end.
                cut = piece.rfind(b"\r", 0, -1) + 1
            rest = piece[cut:]
            piece, skipped = _without(plain_ends(piece[:cut]), skipped)
            if piece:
                yield piece
        piece, _ = _without(plain_ends(rest), skipped)
        if piece:
            yield piece


def _without(piece: bytes, lines: int) -> tuple[bytes, int]:
    """A piece without its first lines, and how many of these are in the next pieces."""
    while lines and piece:
        end = piece.find(b"\n") + 1 or len(piece)
        # Most of a long preamble is passed over at once.
        piece, lines = piece[end:], lines - 1
    return piece, lines


def joined_pieces(pieces: Iterator[bytes], separator: str, width: int) -> Iterator[bytes]:
    """Pieces in which the lines of a cell in quotation marks are one line, and those after its first are blank."""
    rest = b""
    for piece in pieces:
        if b'"' not in piece and not rest:
            yield piece
            continue
        lines = (rest + piece).split(b"\n")
        # After the last line feed is nothing, or a line without an end.
        begun = _join(lines, len(lines) - 1, separator, width)
        piece, rest = b"\n".join([*lines[:begun], b""]), b"\n".join(lines[begun:])
        if piece:
            yield piece
    if rest:
        lines = rest.split(b"\n")
        _join(lines, len(lines), separator, width)
        yield b"\n".join(lines)


def _join(lines: list[bytes], count: int, separator: str, width: int) -> int:
    """Join the first lines in place where a cell covers several; from which of them on a cell may go on behind them."""
    spans, begun = spans_of(lines[:count], separator, width)
    for start, end in spans:
        lines[start:end] = [HELD_END.encode().join(lines[start:end]), *[b""] * (end - start - 1)]
    return begun


def spans_of(lines: Sequence[bytes], separator: str, width: int) -> tuple[list[tuple[int, int]], int]:
    """The lines that are one row of so many cells, since a cell in quotation marks covers several; the first and that after.

    **Returns:** them, and from which line on a cell may go on behind these lines; a mark that no other closes is one too many.
    """
    spans, until = list[tuple[int, int]](), 0
    for k, line in enumerate(lines):
        if k < until or line.count(b'"') % 2 == 0 or line[:1] == b"#":
            continue
        for end in range(k + 2, k + 1 + _MOST_LINES):
            if end > len(lines):
                return spans, k
            own = b"\n".join(lines[k:end])
            if own.count(b'"') % 2 == 0:
                if _is_whole(own, separator, width):
                    spans.append((k, end))
                    until = end
                break
    return spans, len(lines)


def _is_whole(lines: bytes, separator: str, width: int) -> bool:
    """Whether lines are one row, strictly as CSV."""
    try:
        cells = strict_cells(lines.decode("utf-8", "replace"), separator)
    except csv.Error:
        return False
    return len(cells) == width or (len(cells) == width + 1 and not cells[-1])


def unquoted(text: bytes, separator: bytes) -> bytes:
    """Text without quotation marks: separators between them are `HELD`, and a mark written twice is one.

    A line with a mark too many loses them all: it would swallow those after it.
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
        parts[1::2] = [part.replace(separator, HELD.encode()) for part in parts[1::2]]
    parts[2:-1:2] = [part or b'"' for part in parts[2:-1:2]]
    return b"".join(parts)


def frame_of(piece: bytes, separator: str, marks: Sequence[str]) -> "pl.DataFrame":
    """The rows of whole lines: columns c0, c1 ... and `more`, which is null for a line of no more cells than columns.

    **Arguments:**

    - `piece`: lines that end in line feeds alone.
    - `marks`: of each column, as `marks_of` finds them; empty for one of words. Numbers that are not written so are null.
    """
    import polars as pl

    comma = HELD if separator == "," else ","
    piece = unquoted(piece, separator.encode())
    # If all numbers have one mark and the other is nowhere, polars reads them as they are.
    decimals = {own[:1] for own in marks}
    direct = comma.encode() not in piece if decimals <= {".", ""} else decimals == {","} and b"." not in piece
    if direct and decimals == {","}:
        piece = piece.replace(comma.encode(), b".")
    piece = _parted(piece, separator, words=not all(marks))
    # A line of as many cells as none should have, so that one too many is seen.
    full = separator.join(["0"] * (len(marks) + 1)).encode() + b"\n"
    schema = {f"c{k}": pl.Float64 if own and direct else pl.String for k, own in enumerate(marks)}
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
    for held, own in ((HELD, separator), (HELD_END, "\n")):
        if held.encode() in piece:
            frame = frame.with_columns(pl.col(pl.String).str.replace_all(held, own, literal=True))
    return frame if direct else frame.with_columns(number_of(f"c{k}", own) for k, own in enumerate(marks) if own)


def _parted(piece: bytes, separator: str, *, words: bool) -> bytes:
    """The lines as polars reads them: one character between cells, no plus signs."""
    between = separator.encode()
    if between == b" ":
        if b"  " in piece or b"\t" in piece or b"\n " in piece or piece[:1] == b" ":
            piece = re.sub(rb"(?m)^ ", b"", re.sub(rb"[ \t]+", b" ", piece))
    elif b" " in piece:
        piece = re.sub(rb" *" + re.escape(between) + rb" *", between, piece) if words else piece.replace(b" ", b"")
    # A separator at the end of a line begins no cell.
    piece = piece.replace(between + b"\n", b"\n")
    return piece if words else piece.replace(b"+", b"")
