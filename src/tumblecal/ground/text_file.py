"""Text files of users: one line for a file that is not text."""

import io
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import BinaryIO

from tumblecal.ground.errors import InputError
from tumblecal.ground.plain_text import first_control
from tumblecal.ground.result_set import require_whole


LONGEST_SHOWN = 60
# Separators and blanks, the only characters in empty cells of a line.
EMPTY_CELLS = ",;| \t\r\n"
_PIECE = 1 << 23
# A comment with commas in the form of a spreadsheet: quoted, followed by empty cells.
_QUOTED_COMMENT = re.compile(r'"(#(?:[^"]|"")*)"[,;|\s]*')
# First bytes of files that are often given instead of text, their kind and the remedy.
_NOT_TEXT = {
    b"PK\x03\x04": "a spreadsheet (.xlsx, .ods) or another zip archive; save the sheet as CSV",
    b"\xd0\xcf\x11\xe0": "an old spreadsheet (.xls); save the sheet as CSV",
    b"PAR1": "a Parquet file; give it a name that ends in .parquet",
    b"\x89HDF": "an HDF5 file; export its table as CSV or Parquet",
    b"MATLAB 5.0": "a MATLAB file; export its table as CSV (writetable)",
    b"%PDF": "a PDF; export its table as CSV",
    b"\x1f\x8b": "compressed by gzip; unpack it (gunzip)",
    b"\xfd7zXZ\x00": "compressed by xz; unpack it (unxz)",
    b"\x28\xb5\x2f\xfd": "compressed by zstd; unpack it (unzstd)",
    b"7z\xbc\xaf\x27\x1c": "a 7-Zip archive; unpack it",
}
# First bytes of JSON, where a table (or TOML) cannot have them; first bytes of pages and figures.
_JSON = {"CSV": (b"{", b"["), "TOML": (b"{",)}
_MARKUP = (b"<!doctype html", b"<html", b"<svg", b"<?xml")
_LONGEST_MARK = 1000
_LARGEST = 500_000_000
# This many zero bytes at every second place only are due to Latin letters in UTF-16.
_FEWEST_ZEROS = 40
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
# Bytes that do not occur in text of any encoding.
_NOT_WRITTEN = re.compile(rb"[\x00-\x08\x0e-\x1f]")
# Length of the end of a text in which its last lines are sought.
_TAIL = 1 << 16
_NUMBER = re.compile(r"[+-]?(\d*)([.,]?)(\d*)(?:[eE][+-]?(\d*))?")


def is_utf16(beginning: bytes) -> bool:
    """Whether a text begins with the byte order mark of UTF-16."""
    return beginning[:2] in _UTF16


def opened(path: Path) -> BinaryIO:
    """A file open for its text in UTF-8; text in UTF-16 with a byte order mark is converted in memory.

    **Raises:** `InputError` for a file that begins like UTF-16 but is not; `OSError` of the operating system.
    """
    file = path.open("rb")
    if not is_utf16(file.read(2)):
        file.seek(0)
        return file
    with file:
        file.seek(0)
        try:
            return io.BytesIO(file.read().decode("utf-16").encode())
        except UnicodeError as error:
            raise InputError(
                f"{path}: not text, although it begins like UTF-16 ({error}); save the file as UTF-8"
            ) from error


@contextmanager
def _being_read(path: Path) -> Iterator[BinaryIO]:
    """As `opened`, with an `InputError` for errors of the operating system."""
    require_whole(path)
    try:
        with opened(path) as file:
            yield file
    except InputError:
        raise
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except IsADirectoryError as error:
        raise InputError(f"{path}: a folder; give a file") from error
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from error


def plain_ends(text: bytes) -> bytes:
    """Lines that end in line feeds, converted from any line ends."""
    return text.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in text else text


def no_text_words(beginning: bytes) -> str | None:
    """Kind of a file with these first bytes, and the remedy; None if it may be text, or is unknown."""
    zeros = sorted(beginning[place:200:2].count(0) for place in (0, 1))
    if not zeros[0] and zeros[1] > _FEWEST_ZEROS:
        return "text in UTF-16 without a byte order mark; save it as UTF-8"
    return next((words for begin, words in _NOT_TEXT.items() if beginning.startswith(begin)), None)


def read_text(path: Path, kind: str = "CSV", *, may_be_empty: bool = False) -> str:
    """The text of a file in UTF-8, with or without a byte order mark.

    **Arguments:**

    - `path`: the file.
    - `kind`: kind of file that is needed, for messages.
    - `may_be_empty`: whether an empty file is accepted.

    **Raises:** `InputError` if it is missing, unreadable, too large, empty or not text.
    """
    with _being_read(path) as file:
        if (size := path.stat().st_size) > _LARGEST:
            raise InputError(f"{path}: {size / 1e9:.3g} GB; a {kind} file that is read as a whole has at most 0.5 GB")
        content = file.read()
    if not may_be_empty and not content.strip():
        raise InputError(f"{path}: the file is empty")
    _check_beginning(path, content, kind)
    return _decoded(path, content, kind, 0)


def check_zero_bytes(path: Path, beginning: bytes, kind: str = "CSV") -> None:
    """Reject a text with some zero bytes, as after a power failure; other files that are not text are accepted here.

    **Raises:** `InputError` naming the line of the first.
    """
    line, text = plain_ends(beginning[: beginning.find(0)]).count(b"\n") + 1, beginning.replace(b"\x00", b"")
    if len(beginning) / 2 < len(text) < len(beginning) and not _NOT_WRITTEN.search(text):
        raise InputError(f"{path}:line {line}: {_zero_byte(kind)}")


def _zero_byte(kind: str) -> str:
    return f"not text (a zero byte); give a {kind} file"


def is_blank(line: str) -> bool:
    """Whether a line of a table has only separators and blanks."""
    return not line.strip().strip(EMPTY_CELLS)


def line_in(path: Path, number: int) -> str:
    """A line of a text, by its number from 1."""
    with io.TextIOWrapper(opened(path), encoding="utf-8", errors="replace") as file:
        return next(islice(file, number - 1, None), "").rstrip("\n")


def comment_in(line: str) -> str | None:
    """The comment in a line, from its #, without quotation marks of a spreadsheet; None for other lines."""
    if line.startswith("#"):
        return line
    quoted = _QUOTED_COMMENT.fullmatch(line) if line.startswith('"#') else None
    return quoted[1].replace('""', '"') if quoted else None


def decoded_pieces(path: Path) -> Iterator[tuple[int, str]]:
    """The text of a table of any size in pieces of complete lines that end in line feeds, each with the number of lines before.

    **Raises:** `InputError` as `read_text` does.
    """
    lines = 0
    with _being_read(path) as file:
        while piece := file.read(_PIECE) + file.readline():
            if not lines:
                _check_beginning(path, piece, "CSV")
            text = _decoded(path, piece, "CSV", lines)
            text = text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
            yield lines, text
            lines += text.count("\n") + (not text.endswith("\n"))


def _check_beginning(path: Path, content: bytes, kind: str) -> None:
    if words := no_text_words(content):
        raise InputError(f"{path}: this is {words}")
    start = content[:_LONGEST_MARK].lstrip().lower()
    wanted = "a table" if kind == "CSV" else kind
    if start[:1] in _JSON.get(kind, ()):
        raise InputError(f"{path}: this is JSON, not {wanted}")
    if start.startswith(_MARKUP):
        raise InputError(f"{path}: this is HTML or XML, not {wanted}")


def _decoded(path: Path, content: bytes, kind: str, lines: int) -> str:
    """The text of bytes after `lines` lines of a file."""
    try:
        text = content.decode("utf-8" if lines else "utf-8-sig")
    except UnicodeDecodeError as error:
        line = lines + plain_ends(content[: error.start]).count(b"\n") + 1
        byte = f"byte {content[error.start]:#04x}"
        if _NOT_WRITTEN.search(content):
            raise InputError(f"{path}:line {line}: not text ({byte}); give a {kind} file in UTF-8") from error
        letter = content[error.start : error.start + 1].decode("cp1252", "replace")
        raise InputError(
            f"{path}:line {line}: not text in UTF-8 ({byte}: {letter} in Latin-1 or Windows-1252); save the file as UTF-8"
        ) from error
    if "\x00" in text:
        line = lines + text[: text.index("\x00")].count("\n") + 1
        raise InputError(f"{path}:line {line}: {_zero_byte(kind)}")
    if (at := first_control(text)) is not None:
        line, column = lines + text[:at].count("\n") + 1, at - text.rfind("\n", 0, at)
        raise InputError(f"{path}:line {line}, column {column}: a control character ({text[at]}); remove it")
    return text


def shown(value: object) -> str:
    """A value of a user file in messages: `repr`, shortened."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # an integer of thousands of digits; lists in lists in lists
        return f"a very large {type(value).__name__}"
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."


def lines_at_end(path: Path) -> tuple[list[str], bool]:
    """The last lines of a text, up to 64 kB, and whether the last one has a line end."""
    with opened(path) as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - _TAIL))
        lines = plain_ends(file.read()).decode("utf-8", "replace").split("\n")
    whole = lines[1:] if size > _TAIL else lines
    return (whole[:-1], True) if whole and not whole[-1] else (whole, False)


def may_be_cut(cell: str, others: Sequence[str], *, digits: str = "fewest") -> bool:
    """Whether the last cell of a line without a line end may be truncated, compared with other cells of its column.

    A number is complete if it has as many decimals as the others (or exponent digits; or digits if no number has decimals). A
    label, or an empty cell, is complete if it equals one of the others. Digits lost beyond the `fewest` decimals are below the
    resolution of the column.

    **Arguments:**

    - `digits`: whether it needs the "fewest" or the "most" decimals of the others.
    """
    if cell in others:
        return False
    others = [other for other in others if other]
    if not others:
        return False
    last, rest = _NUMBER.fullmatch(cell), [_NUMBER.fullmatch(other) for other in others]
    numbers = [match for match in rest if match]
    if last is None or not numbers:
        return True
    exponents = [match[4] for match in numbers if match[4] is not None]
    if exponents and last[4] is not None:
        return len(last[4]) < max(map(len, exponents))
    if exponents and len(exponents) == len(numbers):
        return True
    decimals = [len(match[3]) for match in numbers]
    if not any(decimals) and not last[2]:
        return len(last[1]) < max(len(match[1]) for match in numbers)
    wanted = max(decimals) if exponents or digits == "most" else max(1, min(decimals))
    return len(last[3]) < wanted
