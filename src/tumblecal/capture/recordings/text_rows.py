"""Lines of text as rows: quotation marks, separators, decimal and thousands marks; a piece of a file at a time."""

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from tumblecal.ground.decimal_marks import NUMBER


if TYPE_CHECKING:
    import polars as pl

# Stands for a separator within quotation marks until the cells are parted.
HELD = "\x02"


def cells_of(line: str, separator: str) -> list[str]:
    """The cells of a line, without the empty one behind a separator at its end."""
    line = unquoted(line.encode(), separator.encode()).decode()
    words = line.split() if separator == " " else [word.strip() for word in line.split(separator)]
    words = words[:-1] if words and words[-1] == "" and separator != " " else words
    return [word.replace(HELD, separator) for word in words]


def numbers_in(row: Sequence[str]) -> int:
    """How many cells are numbers."""
    return sum(bool(NUMBER.fullmatch(cell)) for cell in row)


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
    - `marks`: of each column, as `marks_of` tells them; empty for one of words. Numbers that are not written so are null.
    """
    import polars as pl

    comma = HELD if separator == "," else ","
    piece = unquoted(piece, separator.encode())
    # Where all numbers have one mark and the other is nowhere, the table's reader takes them as they are.
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
    if HELD.encode() in piece:
        frame = frame.with_columns(pl.col(pl.String).str.replace_all(HELD, separator, literal=True))
    return frame if direct else frame.with_columns(_number(f"c{k}", own) for k, own in enumerate(marks) if own)


def _parted(piece: bytes, separator: str, *, words: bool) -> bytes:
    """The lines as the table's reader takes them: one character between cells, no plus signs."""
    between = separator.encode()
    if between == b" ":
        if b"  " in piece or b"\t" in piece or b"\n " in piece or piece[:1] == b" ":
            piece = re.sub(rb"(?m)^ ", b"", re.sub(rb"[ \t]+", b" ", piece))
    elif b" " in piece:
        piece = re.sub(rb" *" + between + rb" *", between, piece) if words else piece.replace(b" ", b"")
    # A separator at the end of a line begins no cell.
    piece = piece.replace(between + b"\n", b"\n")
    return piece if words else piece.replace(b"+", b"")


def _number(name: str, marks: str) -> "pl.Expr":
    """The numbers of a column of text; thousands only where they are grouped by three, and it is known by which mark."""
    import polars as pl

    text = pl.col(name).str.strip_chars_start(" +")
    plain = text
    if marks[0] == ",":
        plain = pl.when(~text.str.contains(".", literal=True)).then(text.str.replace(",", ".", literal=True))
    number = plain.cast(pl.Float64, strict=False)
    if marks[1:]:
        decimal, group = (re.escape(mark) for mark in marks)
        grouped = pl.when(text.str.contains(rf"^-?[1-9]\d{{0,2}}({group}\d{{3}})+({decimal}\d*)?$")).then(text)
        whole = grouped.str.replace_all(marks[1], "", literal=True).str.replace(marks[0], ".", literal=True)
        number = pl.coalesce(number, whole.cast(pl.Float64, strict=False))
    return number.alias(name)
