"""A text table with its readings replaced; all other bytes, including comments and line ends, are unchanged."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float

from tumblecal.capture.recordings.table import TextCells
from tumblecal.data.files import stated
from tumblecal.data.text_cells import row_lines, spans_of
from tumblecal.data.text_layout import TextLayout
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import opened


_PIECE = 1 << 23
_END = re.compile("(\r\n|\n|\r)")
_UTF8_MARK = b"\xef\xbb\xbf".decode("latin-1")
# A byte is one letter here (Latin-1). Letters beyond Latin-1 replace separators and line ends within quotation marks, and
# mark the start of a word if blanks separate the cells.
_SEPARATOR, _LINE_FEED, _RETURN, _WORD = "\ue000", "\ue001", "\ue002", "\ue003"
# Characters around a number that do not change: blanks, quotation marks, the mark of a comment before a header.
_BEFORE, _BEHIND = r'^([ \t"#]*)', r'([ \t"]*)$'


@dataclass(frozen=True)
class HeaderChanges:
    """Changes of a corrected text outside its rows.

    **Arguments:**

    - `added`: comments above the header. `removed`: comments with one of these keys are removed.
    - `names`: new names of the three columns; empty for no change.
    """

    added: Sequence[str]
    removed: frozenset[str] = frozenset()
    names: Sequence[str] = ()


def replaced_text(
    path: Path, cells: TextCells, readings: Iterator[Float[np.ndarray, "rows 3"]], changes: HeaderChanges
) -> Iterator[bytes]:
    """The bytes of a text table with replaced readings, in pieces.

    **Arguments:**

    - `readings`: readings of all rows in order, in pieces of any length; rows of NaN are removed from the text.

    **Raises:** `InputError` if the numbers of rows and of readings differ.
    """
    new, before, layout = _Queue(readings), 0, cells.layout
    for lines, ends in _lines(path, layout):
        first = max(0, layout.first_line - 1 - before)
        is_row = row_lines("\n".join([*lines[first:], ""]).encode("latin-1", "replace")) if lines[first:] else []
        at = range(first, len(lines)) if is_row is None else [k for k, used in enumerate(is_row, first) if used]
        values = new.read(len(at))
        if len(values) < len(at):
            raise _uncertain(path)
        whole = np.all(np.isfinite(values), axis=1)
        for row in np.flatnonzero(~whole):
            lines[at[row]] = ends[at[row]] = ""
        rows = at if whole.all() else [at[row] for row in np.flatnonzero(whole)]
        chosen = lines if len(rows) == len(lines) else [lines[k] for k in rows]
        for k, text in zip(rows, _with_cells(chosen, cells, _texts(values[whole], cells.decimal)), strict=True):
            lines[k] = text
        if before < (layout.header_line or 0) or changes.removed:
            _change(lines, ends, before, cells, changes)
        before += len(lines)
        yield _released(_joined(lines, ends), layout.separator).encode("latin-1")
    if len(new.read(1)):
        raise _uncertain(path)


def _uncertain(path: Path) -> InputError:
    return InputError(f"{path}: a quotation mark opens a cell without a closing one; check the quotation marks")


class _Queue:
    """Rows of numbers, received in pieces and returned in pieces of other lengths."""

    def __init__(self, pieces: Iterator[Float[np.ndarray, "rows 3"]]):
        self._pieces = pieces
        self._waiting = np.zeros((0, 3))

    def read(self, count: int) -> Float[np.ndarray, "rows 3"]:
        """The next rows; fewer at the end."""
        while len(self._waiting) < count and (piece := next(self._pieces, None)) is not None:
            self._waiting = np.concatenate([self._waiting, piece])
        rows, self._waiting = self._waiting[:count], self._waiting[count:]
        return rows


def _lines(path: Path, layout: TextLayout) -> Iterator[tuple[list[str], list[str]]]:
    """Lines of a text and their ends, some megabytes at a time; a cell of several lines is in the first; others are empty."""
    rest, before = "", 0
    with opened(path) as file:
        while piece := file.read(_PIECE) + file.readline():
            text = rest + piece.decode("latin-1")
            lines, ends = _parted(text)
            rest = ""
            if '"' in text:
                begun = _hold(lines, ends, layout, max(0, layout.first_line - 1 - before))
                rest = "".join(map("".join, zip(lines[begun:], ends[begun:], strict=True)))
                lines, ends = lines[:begun], ends[:begun]
            before += len(lines)
            if lines:
                yield lines, ends
    if rest:
        lines, ends = _parted(rest)
        _hold(lines, ends, layout, max(0, layout.first_line - 1 - before))
        yield lines, ends


def _parted(text: str) -> tuple[list[str], list[str]]:
    """The lines of a text, and the end of each."""
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


def _hold(lines: list[str], ends: list[str], layout: TextLayout, first: int) -> int:
    """Replace separators and line ends within quotation marks, in place; the start of a cell that extends beyond the text."""
    plain = [line.encode("latin-1") for line in lines[first:]]
    spans, begun = spans_of(plain, layout.separator, len(layout.names))
    for start, end in ((first + start, first + end) for start, end in spans):
        whole = "".join(map("".join, zip(lines[start:end], [*ends[start : end - 1], ""], strict=True)))
        lines[start] = whole.replace("\r", _RETURN).replace("\n", _LINE_FEED)
        ends[start] = ends[end - 1]
        lines[start + 1 : end] = ends[start + 1 : end] = [""] * (end - start - 1)
    for k in range(first, first + begun):
        parts = lines[k].split('"')
        if len(parts) % 2 and len(parts) > 1:
            parts[1::2] = [part.replace(layout.separator, _SEPARATOR) for part in parts[1::2]]
            lines[k] = '"'.join(parts)
    return first + begun


def _released(text: str, separator: str) -> str:
    for held, original in ((_SEPARATOR, separator), (_LINE_FEED, "\n"), (_RETURN, "\r")):
        text = text.replace(held, original) if held in text else text
    return text


def _texts(values: Float[np.ndarray, "rows 3"], decimal: str) -> list[pl.Series]:
    """Numbers of the three axes as text, with all digits."""
    texts = [pl.Series(np.ascontiguousarray(column), dtype=pl.Float64).cast(pl.String) for column in values.T]
    return [text.str.replace(".", decimal, literal=True) for text in texts] if decimal != "." else texts


def _with_cells(lines: list[str], cells: TextCells, texts: Sequence[pl.Series]) -> list[str]:
    """Lines with new texts in the three cells; blanks and quotation marks around a cell do not change."""
    mark, shift, between = cells.layout.separator, 0, cells.layout.separator
    series = pl.Series("line", lines, dtype=pl.String)
    if mark == " ":
        # A cell is a word with the following blanks; the first cell is the blanks before all words.
        series = series.str.replace_all(r"(^|[ \t])([^ \t])", f"${{1}}{_WORD}$2")
        mark, shift, between = _WORD, 1, ""
    count = max(cells.places) + shift + 2
    names = [str(k) for k in range(count)]
    table = series.to_frame().select(pl.col("line").str.splitn(mark, count).struct.rename_fields(names)).unnest("line")
    text = "\n".join(lines)
    around = shift or any(letter in text for letter in '" #')
    for place, new in zip(cells.places, texts, strict=True):
        old = table[str(place + shift)]
        cell = old.str.extract(_BEFORE) + new + old.str.extract(_BEHIND) if around else new
        table = table.with_columns(cell.alias(old.name))
    return table.select(pl.concat_str(pl.all(), separator=between, ignore_nulls=True)).to_series().to_list()


def _change(lines: list[str], ends: list[str], before: int, cells: TextCells, changes: HeaderChanges) -> None:
    """Change the header and the comments among some lines, in place; `before` lines precede them."""
    for k, line in enumerate(lines):
        if changes.removed and stated([line]).keys() & changes.removed:
            lines[k] = ends[k] = ""
    at = (cells.layout.header_line or 0) - 1 - before
    if not 0 <= at < len(lines):
        return
    if changes.names:
        (lines[at],) = _with_cells([lines[at]], cells, [pl.Series([name]) for name in changes.names])
    mark = _UTF8_MARK if (cells.layout.header_line or 0) == 1 and lines[at].startswith(_UTF8_MARK) else ""
    added = "".join(note.encode("utf-8").decode("latin-1") + (ends[at] or "\n") for note in changes.added)
    lines[at] = mark + added + lines[at].removeprefix(mark)
