"""A text table with its readings replaced: every other byte, comments and ends of lines included, stays as it was."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from tumblecal.data.files import stated
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import EMPTY_CELLS, opened


if TYPE_CHECKING:
    import polars as pl

_PIECE = 1 << 23
_END = re.compile("(\r\n|\n|\r)")
# How a line begins that may be no row.
_NO_ROW = tuple(f"\n{letter}" for letter in EMPTY_CELLS + "#")
_UTF8_MARK = b"\xef\xbb\xbf".decode("latin-1")
# A byte is one letter here (Latin-1). Letters beyond these stand for a separator and for ends of lines within quotation
# marks, and for the beginning of a word where blanks are between the cells.
_SEPARATOR, _LINE_FEED, _RETURN, _WORD = "\ue000", "\ue001", "\ue002", "\ue003"
# What is kept around a number: blanks, quotation marks, the mark of a comment before a header.
_BEFORE, _BEHIND = r'^([ \t"#]*)', r'([ \t"]*)$'


@dataclass(frozen=True)
class TextCells:
    """Where the readings of a text table are.

    **Arguments:**

    - `places`: the cells of the three axes in a row, from 0, once they are known.
    - `separator`: between cells; a space means any blanks.
    - `decimal`: the mark of the numbers. `header_line`, `first_line`: the names and the first row, from 1.
    - `spanning`: whether a cell in quotation marks may go over several lines.
    """

    places: tuple[int, ...]
    separator: str
    decimal: str
    header_line: int
    first_line: int
    spanning: bool = False


@dataclass(frozen=True)
class HeaderChanges:
    """How a corrected text differs outside its rows.

    **Arguments:**

    - `added`: comments, above the header. `removed`: comments that state one of these keys are left out.
    - `names`: of the three columns; empty where they stay.
    """

    added: Sequence[str]
    removed: frozenset[str] = frozenset()
    names: Sequence[str] = ()


def replaced_text(
    path: Path, cells: TextCells, readings: Iterator[Float[np.ndarray, "rows 3"]], changes: HeaderChanges
) -> Iterator[bytes]:
    """The bytes of a text table with other readings, a piece at a time.

    **Arguments:**

    - `readings`: of all rows in order, in pieces of any length; rows of NaN are left out of the text.

    **Raises:** `InputError` where the text has more rows than readings, or fewer.
    """
    new, before = _Queue(readings), 0
    for lines, ends in _lines(path, cells):
        text = "\n".join(["", *lines, ""])
        if before < cells.first_line - 1 or any(begin in text for begin in _NO_ROW):
            at = [k for k, line in enumerate(lines) if before + k + 1 >= cells.first_line and _is_row(line)]
        else:
            at = list(range(len(lines)))
        values = new.taken(len(at))
        if len(values) < len(at):
            raise _uncertain(path)
        kept = np.all(np.isfinite(values), axis=1)
        for row in np.flatnonzero(~kept):
            lines[at[row]] = ends[at[row]] = ""
        rows = at if kept.all() else [at[row] for row in np.flatnonzero(kept)]
        own = lines if len(rows) == len(lines) else [lines[k] for k in rows]
        for k, text in zip(rows, _with_cells(own, cells, _texts(values[kept], cells.decimal)), strict=True):
            lines[k] = text
        if before < cells.header_line or changes.removed:
            _change(lines, ends, before, cells, changes)
        before += len(lines)
        yield _released(_joined(lines, ends), cells.separator).encode("latin-1")
    if len(new.taken(1)):
        raise _uncertain(path)


def _uncertain(path: Path) -> InputError:
    return InputError(f"{path}: a quotation mark opens a cell and none closes it; check the quotation marks")


class _Queue:
    """Rows of numbers that come in pieces and are taken in others."""

    def __init__(self, pieces: Iterator[Float[np.ndarray, "rows 3"]]):
        self._pieces = pieces
        self._waiting = np.zeros((0, 3))

    def taken(self, count: int) -> Float[np.ndarray, "rows 3"]:
        """The next rows; fewer at the end."""
        while len(self._waiting) < count and (piece := next(self._pieces, None)) is not None:
            self._waiting = np.concatenate([self._waiting, piece])
        rows, self._waiting = self._waiting[:count], self._waiting[count:]
        return rows


def _is_row(line: str) -> bool:
    return not line.startswith("#") and bool(line.strip(EMPTY_CELLS))


def _lines(path: Path, cells: TextCells) -> Iterator[tuple[list[str], list[str]]]:
    """Lines of a text and their ends, some megabytes at a time; what quotation marks hold together is one line."""
    rest = ""
    with opened(path) as file:
        while piece := file.read(_PIECE) + file.readline():
            text = rest + piece.decode("latin-1")
            lines, ends = _parted(text)
            rest = ""
            if '"' in text:
                lines, ends, rest = _quoted(lines, ends, cells)
            yield lines, ends
    if rest:
        yield [rest], [""]


def _parted(text: str) -> tuple[list[str], list[str]]:
    """The lines of a text, and what ends each."""
    returns = text.count("\r")
    end = "\r\n" if returns and returns == text.count("\r\n") == text.count("\n") else "\n"
    if end == "\n" and returns:
        parts = [*_END.split(text), ""]
        lines, ends = parts[0::2], parts[1::2]
    else:
        lines = text.split(end)
        ends = [end] * (len(lines) - 1) + [""]
    return (lines, ends) if lines[-1] else (lines[:-1], ends[:-1])


def _joined(lines: list[str], ends: list[str]) -> str:
    if len(set(ends)) == 1:
        return ends[0].join(lines) + ends[0]
    return "".join([line + end for line, end in zip(lines, ends, strict=True)])


def _quoted(lines: list[str], ends: list[str], cells: TextCells) -> tuple[list[str], list[str], str]:
    """Lines whose separators within quotation marks are held, and the beginning of a cell that goes on in the next piece."""
    whole, their_ends, begun = list[str](), list[str](), ""
    for line, end in zip(lines, ends, strict=True):
        line = begun + line
        if (begun or not line.startswith("#")) and cells.spanning and line.count('"') % 2:
            begun = line + end.replace("\r", _RETURN).replace("\n", _LINE_FEED)
            continue
        parts, begun = line.split('"'), ""
        if len(parts) % 2:
            parts[1::2] = [part.replace(cells.separator, _SEPARATOR) for part in parts[1::2]]
        whole.append('"'.join(parts))
        their_ends.append(end)
    return whole, their_ends, begun.replace(_RETURN, "\r").replace(_LINE_FEED, "\n")


def _released(text: str, separator: str) -> str:
    for held, own in ((_SEPARATOR, separator), (_LINE_FEED, "\n"), (_RETURN, "\r")):
        text = text.replace(held, own) if held in text else text
    return text


def _texts(values: Float[np.ndarray, "rows 3"], decimal: str) -> list["pl.Series"]:
    """Numbers of the three axes as text, with all digits."""
    import polars as pl

    texts = [pl.Series(np.ascontiguousarray(column), dtype=pl.Float64).cast(pl.String) for column in values.T]
    return [text.str.replace(".", decimal, literal=True) for text in texts] if decimal != "." else texts


def _with_cells(lines: list[str], cells: TextCells, texts: Sequence["pl.Series"]) -> list[str]:
    """Lines with other texts in the three cells; blanks and quotation marks around a cell stay."""
    import polars as pl

    mark, shift, between = cells.separator, 0, cells.separator
    own = pl.Series("line", lines, dtype=pl.String)
    if mark == " ":
        # A cell is a word with the blanks behind it; the first one is the blanks before all words.
        own = own.str.replace_all(r"(^|[ \t])([^ \t])", f"${{1}}{_WORD}$2")
        mark, shift, between = _WORD, 1, ""
    count = max(cells.places) + shift + 2
    names = [str(k) for k in range(count)]
    table = own.to_frame().select(pl.col("line").str.splitn(mark, count).struct.rename_fields(names)).unnest("line")
    text = "\n".join(lines)
    around = shift or any(letter in text for letter in '" #')
    for place, new in zip(cells.places, texts, strict=True):
        old = table[str(place + shift)]
        cell = old.str.extract(_BEFORE) + new + old.str.extract(_BEHIND) if around else new
        table = table.with_columns(cell.alias(old.name))
    return table.select(pl.concat_str(pl.all(), separator=between, ignore_nulls=True)).to_series().to_list()


def _change(lines: list[str], ends: list[str], before: int, cells: TextCells, changes: HeaderChanges) -> None:
    """Change the header and the comments among some lines, in place; `before` lines stand ahead of them."""
    import polars as pl

    for k, line in enumerate(lines):
        if changes.removed and stated([line]).keys() & changes.removed:
            lines[k] = ends[k] = ""
    at = cells.header_line - 1 - before
    if not 0 <= at < len(lines):
        return
    if changes.names:
        (lines[at],) = _with_cells([lines[at]], cells, [pl.Series([name]) for name in changes.names])
    mark = _UTF8_MARK if cells.header_line == 1 and lines[at].startswith(_UTF8_MARK) else ""
    added = "".join(note.encode("utf-8").decode("latin-1") + (ends[at] or "\n") for note in changes.added)
    lines[at] = mark + added + lines[at].removeprefix(mark)
