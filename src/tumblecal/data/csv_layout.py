"""How a CSV table is laid out: which line names the columns, and what stands between them."""

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tumblecal.data.table import KNOWN
from tumblecal.ground.axes import AXES
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import UNITS
from tumblecal.ground.last_line import may_be_cut
from tumblecal.ground.text_file import opened, read_beside_rows, shown


# Excel's first line `sep=;`.
_SAID = re.compile(r'\s*"?sep=([^"\s]|\t)"?[\s,;]*', re.IGNORECASE)
_UNITS = {"deg", "°", "g", "mg", "m/s2", "m/s^2", "m/s²", "s", "ms", "degC", "°C", "C", "1"}
_NUMBER = re.compile(r"\s*[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?\s*")


@dataclass(frozen=True)
class CsvLayout:
    """The names of the columns, the line that holds them, that from which on the rows stand (from 1), and the separator."""

    names: tuple[str, ...]
    header_line: int
    rows_from: int
    separator: str

    def repeated(self, path: Path) -> list[str]:
        """A fault for each name that several columns have."""
        twice = sorted({name for name in self.names if self.names.count(name) > 1})
        return [
            f"{path}:line {self.header_line}, column {name or '(no name)'}: the column stands twice; keep one"
            for name in twice
        ]

    def names_of_cells(self, beginning: Sequence[tuple[int, str]]) -> tuple[str, ...]:
        """The names, and one that is empty where the first row ends in a separator that the header lacks."""
        row = next((text for number, text in beginning if number >= self.rows_from), "")
        cells = cells_of(row, self.separator)
        open_end = len(cells) == len(self.names) + 1 and not cells[-1] and "" not in self.names
        return (*self.names, "") if open_end else self.names


def readings_among(names: Sequence[str]) -> bool:
    """Whether these are columns of a table of readings."""
    return any(all(f"a{axis}_{unit}" in names for axis in AXES) for unit in UNITS)


def csv_layout(path: Path, beginning: Sequence[tuple[int, str]], comments: Sequence[tuple[int, str]] = ()) -> CsvLayout:
    """The layout of a table by its first lines.

    A header may stand behind the mark of a comment, as numpy writes it: where it names readings, and numbers stand below.

    **Arguments:**

    - `beginning`: the first lines with their numbers, neither blank nor comments; three of them suffice.
    - `comments`: comment lines with theirs.

    **Raises:** `InputError` where no line names the columns.
    """
    said = _SAID.fullmatch(beginning[0][1]) if beginning else None
    if said and said[1] not in ",;\t":
        raise InputError(
            f"{path}:line {beginning[0][0]}: {shown(said[1])} as separator; write the columns with commas, semicolons or tabs"
        )
    beginning = beginning[1:] if said else beginning
    if not beginning:
        raise InputError(f"{path}: no header line; the first line names the columns")
    line, text = beginning[0]
    for number, comment in reversed([own for own in comments if own[0] < line]):
        header = comment.lstrip("# ")
        separator = said[1] if said else _separator(header)
        names, cells = cells_of(header, separator), cells_of(text, separator)
        if readings_among(names) and len(cells) == len(names) and _of_numbers(cells):
            return CsvLayout(names, number, line, separator)
    separator = said[1] if said else _separator(text)
    try:
        names = cells_of(text, separator, strict=True)
    except csv.Error as error:
        raise InputError(f"{path}:line {line}: {error}; check the quotation marks") from error
    _check_title(path, beginning, names)
    if _of_numbers(names):
        raise InputError(
            f"{path}:line {line}: numbers stand where the names of the columns should; write them in the first line that is no "
            "comment, such as position,alpha_deg,beta_deg,ax_g,ay_g,az_g"
        )
    return CsvLayout(names, line, line + 1, separator)


def _check_title(path: Path, beginning: Sequence[tuple[int, str]], names: Sequence[str]) -> None:
    """Refuse a first line that names fewer columns than the next does: a title, or the groups of a header over two lines."""
    (line, text), (number, below) = beginning[0], beginning[1] if len(beginning) > 1 else (0, "")
    there = [cell for cell in cells_of(below, _separator(below)) if cell]
    fewer = sum(map(bool, names)) == 1 and len(there) > 2
    if not any(map(_NUMBER.fullmatch, there)) and (fewer or _known(there) > max(2, _known(names))):
        raise InputError(
            f"{path}:line {line}: {shown(text.rstrip(',; '))} is no header: line {number} names the columns; put # before line "
            f"{line}"
        )


def _known(names: Sequence[str]) -> int:
    return sum(name in KNOWN for name in names)


def rows_behind_marks(path: Path, layout: CsvLayout, comments: Sequence[tuple[int, str]]) -> list[str]:
    """A fault for each comment below the header that is a row of numbers whose first cell begins with #: no reading is lost."""
    found = [(line, cells_of(text, layout.separator)) for line, text in comments if line >= layout.rows_from]
    return [
        f"{path}:line {line}: begins with # as a comment does, but a row of numbers follows; write "
        f"{shown(cells[0].strip('# '))} without the #, or, to leave the row out, '# left out:' before it"
        for line, cells in found
        if len(cells) == len(layout.names) > 3 and ":" not in cells[0] and _of_numbers(cells[1:])
    ]


def row_words(cells: Sequence[str], names: Sequence[str]) -> str:
    """What is wrong with the cells of a line as a row below these names; nothing where it may be one."""
    if [cell.strip() for cell in cells] == list(names):
        return "the names of the columns again; remove the line"
    written = [cell.strip().strip("[]()") for cell in cells if cell.strip(" -")]
    if len(written) > 1 and set(written) <= _UNITS:
        return "a line of units, no row; put # before it: the names of the columns say the units"
    if len(cells) == len(names):
        return ""
    cure = "remove the row" if len(cells) > len(names) else "complete the row or remove it"
    return f"{counted(len(cells), 'cell')}, but the header has {len(names)}; {cure}"


def cut_row(path: Path, number: int, names: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A fault for the last of some rows, whose line (`number`) is the file's last and has no end, where it may be cut off."""
    cells, others = rows[-1], [row for row in rows[:-1] if len(row) == len(names)]
    if len(cells) == len(names) and not may_be_cut(cells[-1].strip(), [row[-1].strip() for row in others]):
        return ""
    column = f", column {names[len(cells) - 1]}" if 0 < len(cells) <= len(names) else ""
    return (
        f"{path}:line {number}{column}: the last line has no end, and {shown(cells[-1].strip())} is shorter than in other "
        "rows: it may be cut off; complete the row and end its line, or remove it"
    )


def longer_row(path: Path) -> str:
    """A fault for the first row of a table with more cells than its header has, looked for once it is known to be there."""
    beside = read_beside_rows(path)
    layout = csv_layout(path, beside.beginning, beside.comments)
    width = len(layout.names_of_cells(beside.beginning))
    with io.TextIOWrapper(opened(path), encoding="utf-8", errors="replace") as file:
        for number, text in enumerate(file, start=1):
            if number >= layout.rows_from and not text.startswith("#") and text.count(layout.separator) >= width:
                cells = cells_of(text.rstrip("\n"), layout.separator)
                if len(cells) > width:
                    return f"{path}:line {number}: {row_words(cells, layout.names)}"
    return f"{path}: a row has more cells than the header; check the quotation marks"


def _separator(header: str) -> str:
    """What separates the columns: a comma, or a semicolon or tab where a spreadsheet wrote them."""
    return max(",;\t", key=header.count)


def cells_of(text: str, separator: str, *, strict: bool = False) -> tuple[str, ...]:
    """The cells of a line, without the blanks around them."""
    try:
        cells = next(csv.reader([text], strict=strict, delimiter=separator), [])
    except csv.Error:
        if strict:
            raise
        # A cell of more than any: what is looked for in it does not stand within quotation marks.
        cells = text.split(separator)
    return tuple(cell.strip() for cell in cells)


def _of_numbers(cells: Sequence[str]) -> bool:
    """Whether most cells are numbers, so that this is no header."""
    return 2 * sum(bool(_NUMBER.fullmatch(cell)) for cell in cells) > len(cells)
