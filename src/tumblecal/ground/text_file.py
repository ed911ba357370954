"""Text files that people write: everything that is not text is told in one line."""

import json
import re
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

from tumblecal.ground.errors import InputError


LONGEST_SHOWN = 60
_PIECE = 1 << 23
# So many lines tell how a table is laid out: what Excel writes of its separator, the header, the first row.
_BEGINNING = 3
# A comment with commas as a spreadsheet writes it: in quotation marks, empty cells behind.
_QUOTED_COMMENT = re.compile(r'"(#(?:[^"]|"")*)"[,;\s]*')
_BLANK_FIRST = re.compile(r"\n\s")
_COMMENT, _BLANK = re.compile("^#.*", re.MULTILINE), re.compile(r"^[^\S\n]*\n|^[^\S\n]+\Z", re.MULTILINE)
# How files begin that are often given for text, what they are, and what to do.
_NO_TEXT = {
    b"PK\x03\x04": "a spreadsheet (.xlsx, .ods) or another zip archive; save the sheet as CSV",
    b"\xd0\xcf\x11\xe0": "an old spreadsheet (.xls); save the sheet as CSV",
    b"PAR1": "a Parquet file; give it a name that ends in .parquet",
    b"\x89HDF": "an HDF5 file; export its table as CSV or Parquet",
    b"MATLAB 5.0": "a MATLAB file; export its table as CSV (writetable)",
    b"%PDF": "a PDF; export its table as CSV",
}


def read_text(path: Path, kind: str = "CSV", *, may_be_empty: bool = False) -> str:
    """The text of a file in UTF-8, with or without a byte order mark.

    **Arguments:**

    - `path`: the file.
    - `kind`: what it should be, for the advice.
    - `may_be_empty`: whether a file without a word is one.

    **Raises:** `InputError` when it is missing, unreadable, empty or not text.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from error
    if not may_be_empty and not content.strip():
        raise InputError(f"{path}: the file is empty")
    _check_beginning(path, content, kind)
    return _decoded(path, content, kind, 0)


def comment_in(line: str) -> str | None:
    """The comment that a line is, from its #, without the quotation marks of a spreadsheet; None for other lines."""
    if line.startswith("#"):
        return line
    quoted = _QUOTED_COMMENT.fullmatch(line) if line.startswith('"#') else None
    return quoted[1].replace('""', '"') if quoted else None


def read_json(path: Path) -> object:
    """What a JSON file holds.

    **Raises:** `InputError` for a file that cannot be read or is not JSON, and for a key that stands twice in an object.
    """
    text = read_text(path, "JSON")
    try:
        return json.loads(text, object_pairs_hook=without_repeats)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except json.JSONDecodeError as error:
        raise InputError(f"{path}:line {error.lineno}, column {error.colno}: not JSON: {error.msg}") from error
    except RecursionError as error:
        raise InputError(f"{path}: not JSON that can be read: nested too deeply") from error
    except ValueError as error:  # an integer of thousands of digits
        raise InputError(f"{path}: not JSON: {error}") from error


def read_json_object(path: Path) -> dict[str, Any]:
    """The object that a JSON file holds.

    **Raises:** `InputError` as `read_json` does, and for a file that holds something else.
    """
    content = read_json(path)
    if not isinstance(content, dict):
        raise InputError(f"{path}: not a JSON object")
    return content


def without_repeats(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """A JSON object's content, for `json.loads`: of a key that stands twice Python would keep the last value.

    **Raises:** `InputError` for such a key.
    """
    content = dict(pairs)
    if len(content) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in content if keys.count(key) > 1)
        raise InputError(f"the key {shown(twice)} stands twice in one object; remove one of them")
    return content


@dataclass(frozen=True)
class BesideRows:
    """What stands in a text table beside its rows.

    Lines count from 1: `comments` with their text, `blank` lines, and the `beginning`: the first lines that are neither.
    Comments in quotation marks are some ahead of the beginning alone.
    """

    comments: list[tuple[int, str]] = field(default_factory=list)
    blank: array = field(default_factory=lambda: array("q"))
    beginning: list[tuple[int, str]] = field(default_factory=list)

    def add(self, text: str, before: int) -> None:
        """Look at whole lines, `before` of which stand ahead of them in the file."""
        if len(self.beginning) < _BEGINNING:
            own = ((k, line) for k, line in enumerate(text.split("\n"), before + 1) if line.strip() and line[0] != "#")
            if not self.beginning:
                own = self._after_quoted(own)
            self.beginning.extend(islice(own, _BEGINNING - len(self.beginning)))
        if "#" in text:
            self.comments.extend((line, match[0]) for line, match in _numbered(_COMMENT, text, before))
        # Most texts have no line that begins with a blank, which is quicker seen than each line looked at.
        if text[:1].isspace() or _BLANK_FIRST.search(text):
            self.blank.extend(line for line, _ in _numbered(_BLANK, text, before))

    def _after_quoted(self, lines: Iterator[tuple[int, str]]) -> Iterator[tuple[int, str]]:
        """The lines from the first on that is no comment in quotation marks; these are kept."""
        for number, line in lines:
            comment = comment_in(line)
            if comment is None:
                yield number, line
                break
            self.comments.append((number, comment))
        yield from lines


def _numbered(pattern: re.Pattern[str], text: str, before: int) -> Iterator[tuple[int, re.Match[str]]]:
    """The matches of a pattern in whole lines, each with its line."""
    line, at = before + 1, 0
    for match in pattern.finditer(text):
        line += text.count("\n", at, match.start())
        at = match.start()
        yield line, match


def read_beside_rows(path: Path, kind: str = "CSV") -> BesideRows:
    """What stands beside the rows of a text table of any size.

    **Raises:** `InputError` as `read_text` does, and for a file of comments alone.
    """
    beside, lines = BesideRows(), 0
    try:
        with path.open("rb") as file:
            while piece := file.read(_PIECE) + file.readline():
                if not lines:
                    _check_beginning(path, piece, kind)
                text = _decoded(path, piece, kind, lines)
                text = text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
                beside.add(text, lines)
                lines += text.count("\n")
    except InputError:
        raise
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from error
    if not beside.beginning:
        raise InputError(
            f"{path}: no header line; the first line names the columns"
            if beside.comments
            else f"{path}: the file is empty"
        )
    return beside


def _check_beginning(path: Path, content: bytes, kind: str) -> None:
    for beginning, words in _NO_TEXT.items():
        if content.startswith(beginning):
            raise InputError(f"{path}: this is {words}")
    if kind == "CSV" and content.lstrip()[:1] in (b"{", b"["):
        raise InputError(f"{path}: this is JSON, not a table")
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise InputError(
            f"{path}:line 1: not text in UTF-8 (byte {content[0]:#04x}: UTF-16?); give a {kind} file in UTF-8"
        )


def _decoded(path: Path, content: bytes, kind: str, lines: int) -> str:
    """The text of bytes that stand `lines` lines deep in a file."""
    try:
        text = content.decode("utf-8" if lines else "utf-8-sig")
    except UnicodeDecodeError as error:
        line = lines + content[: error.start].count(b"\n") + 1
        raise InputError(
            f"{path}:line {line}: not text (byte {content[error.start]:#04x}); give a {kind} file in UTF-8"
        ) from error
    if "\x00" in text:
        line = lines + text[: text.index("\x00")].count("\n") + 1
        raise InputError(f"{path}:line {line}: not text (a zero byte); give a {kind} file")
    return text


def shown(value: object) -> str:
    """A value of a user's file as a fault shows it: `repr`, shortened."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # an integer of thousands of digits; lists in lists in lists
        return f"a very large {type(value).__name__}"
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."
