"""Text of any layout: separator, decimal comma, header line and what stands before it are seen in the first lines."""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.capture.protocols.text_layout import separator_of
from tumblecal.capture.recordings.options import Asked
from tumblecal.capture.recordings.table import ROW, Reader, SourceTable
from tumblecal.data.files import stated
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    import polars as pl

_PIECE = 1 << 23
_HEAD = 1 << 16
_FEWEST_LINES = 2
_LINES = 200
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|nan", re.IGNORECASE)
_TEXT_SHARE = 0.95


@dataclass(frozen=True)
class _Layout:
    """How the lines are read: `start` is the place of the first row, `line` its number, `numeric` which columns are."""

    separator: str
    decimal_comma: bool
    columns: tuple[str, ...]
    numeric: tuple[bool, ...]
    start: int
    line: int
    comments: dict[str, str]

    def words(self) -> str:
        names = {" ": "spaces", ",": "commas", ";": "semicolons", "\t": "tabs"}
        said = f"text, {len(self.columns)} columns separated by {names[self.separator]}"
        said += ", decimal comma" if self.decimal_comma else ""
        return said + (f", first row in line {self.line}" if self.line > 1 else ", no header line")


def _is_text(head: bytes) -> bool:
    if b"\x00" in head:
        return False
    usual = sum(byte in b"\t\r\n" or 32 <= byte < 127 for byte in head[:4096])
    return usual > _TEXT_SHARE * len(head[:4096])


def _cells(line: str, separator: str, decimal_comma: bool) -> list[str]:
    words = line.split() if separator == " " else [word.strip().strip('"') for word in line.split(separator)]
    words = words[:-1] if words and words[-1] == "" and separator != " " else words
    return [word.replace(",", ".") for word in words] if decimal_comma else words


def _layout(path: Path) -> _Layout:
    """The layout of a file's first lines.

    **Raises:** `InputError` when no rows of numbers are among them.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD)
    raw_lines = head.splitlines(keepends=True)
    raw_lines = raw_lines[:-1] if len(head) == _HEAD and len(raw_lines) > 1 else raw_lines
    lines = [raw.decode("utf-8-sig", "replace").rstrip("\r\n") for raw in raw_lines]
    # What the lines are made of shows in the middle: preambles stand before, a torn line at the end.
    body = [line for line in lines if line.strip() and not line.startswith("#")]
    separator, decimal_comma = separator_of(body[len(body) // 2 :][:_LINES])
    rows = [[] if line.startswith("#") else _cells(line, separator, decimal_comma) for line in lines]
    widths = Counter(len(row) for row in rows if sum(map(bool, map(_NUMBER.fullmatch, row))) >= 3)
    if not widths or max(widths.values()) < min(_FEWEST_LINES, len(body)):
        shown = next((line for line in body if line.strip()), "")[:60]
        raise InputError(f"{path}: text without rows of three numbers or more, e.g. {shown!r}; give the log itself")
    width = widths.most_common(1)[0][0]
    looks = [len(row) == width and sum(map(bool, map(_NUMBER.fullmatch, row))) >= 3 for row in rows]
    first = looks.index(True)
    names = _names(lines[:first], separator, width)
    numeric = tuple(
        2 * sum(bool(_NUMBER.fullmatch(row[k])) for row, good in zip(rows, looks, strict=True) if good) > sum(looks)
        for k in range(width)
    )
    comments = stated(line for line in lines if line.startswith("#"))
    pairs = [row for row in rows[:first] if len(row) == 2 and all(row)]
    comments |= {key.lower().replace(" ", "_"): value for key, value in pairs}
    return _Layout(separator, decimal_comma, names, numeric, sum(map(len, raw_lines[:first])), first + 1, comments)


def _names(before: list[str], separator: str, width: int) -> tuple[str, ...]:
    """Names of the columns, from the last line before the rows; their numbers where it names none."""
    for line in reversed([line for line in before if line.strip()][-2:]):
        names = _cells(line.lstrip("# "), separator, False)
        if len(names) != width and separator == " ":
            names = _cells(line.lstrip("# "), separator_of([line])[0], False)
        if len(names) == width and len(set(names)) == width and any(re.search("[A-Za-z]", name) for name in names):
            return tuple(names)
    return tuple(str(number + 1) for number in range(width))


def _pieces_of(path: Path, start: int) -> Iterator[bytes]:
    """The lines from a place on, some megabytes at a time, each piece of whole lines."""
    with path.open("rb") as file:
        file.seek(start)
        rest = b""
        while piece := file.read(_PIECE):
            piece = rest + piece
            cut = piece.rfind(b"\n") + 1
            rest = piece[cut:]
            yield piece[:cut]
        yield rest


def _rows_of(piece: bytes) -> list[bool]:
    """Which lines are meant as rows: not empty, no comment."""
    return [bool(line.strip()) and not line.startswith(b"#") for line in piece.removesuffix(b"\n").split(b"\n")]


def _plain(piece: bytes, layout: _Layout) -> bytes:
    """The lines as the table's reader takes them: one character between cells, points in numbers, no plus signs."""
    separator = layout.separator.encode()
    if layout.decimal_comma:
        piece = piece.replace(b",", b".")
    # A quotation mark of a torn line would swallow those after it.
    piece = piece.replace(b'"', b"").replace(b"\r\n", b"\n")
    if separator == b" " and (b"  " in piece or b"\t" in piece or b"\n " in piece or piece[:1] == b" "):
        piece = re.sub(rb"(?m)^ ", b"", re.sub(rb"[ \t]+", b" ", piece))
    elif separator != b" " and b" " in piece and all(layout.numeric):
        piece = piece.replace(b" ", b"")
    # A separator at the end of a line begins no cell.
    piece = piece.replace(separator + b"\n", b"\n")
    return piece.replace(b"+", b"") if all(layout.numeric) else piece


def _read(path: Path, asked: Asked) -> list[SourceTable]:
    layout = _layout(path)
    width = len(layout.columns)

    def pieces(columns: Sequence[str]) -> Iterator["pl.DataFrame"]:
        import polars as pl

        schema = {f"c{k}": pl.Float64 if own else pl.String for k, own in enumerate(layout.numeric)} | {
            "more": pl.String
        }
        # A line of as many cells as none should have, so that one too many is seen.
        full = layout.separator.join(["0"] * (width + 1)).encode() + b"\n"
        line = layout.line
        for piece in _pieces_of(path, layout.start):
            if not piece:
                continue
            frame = pl.read_csv(
                full + _plain(piece, layout),
                has_header=False,
                schema=schema,
                separator=layout.separator,
                truncate_ragged_lines=True,
                ignore_errors=True,
                encoding="utf8-lossy",
                quote_char=None,
            ).slice(1)
            places = pl.Series(ROW, range(line, line + len(frame)))
            line += len(frame)
            cells = [
                pl.when(pl.col("more").is_null()).then(pl.col(f"c{layout.columns.index(name)}")).alias(name)
                for name in columns
            ]
            frame = frame.select(cells).with_columns(places)
            # Told by its characters, which is quicker than looking at each line.
            passed_over = (
                b"#" in piece or piece[:1].isspace() or any(b"\n" + c in piece for c in (b"\n", b"\r", b" ", b"\t"))
            )
            yield frame.filter(pl.Series(_rows_of(piece))) if passed_over else frame

    said = layout.words()
    return [SourceTable("", layout.columns, pieces, comments=layout.comments, said=said, row_word="line")]


READER = Reader("text", lambda path, head: _is_text(head), _read, rank=2)
