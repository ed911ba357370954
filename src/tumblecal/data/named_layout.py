"""The layout of a table with the names of the columns in its first line; each fault has its line."""

import re
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from tumblecal.data.table import KNOWN
from tumblecal.data.text_cells import cells_of, unquoted
from tumblecal.data.text_layout import TextLayout
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import UNITS
from tumblecal.ground.numbers_shown import counted
from tumblecal.ground.text_file import comment_in, decoded_pieces, is_blank, shown


# The first line `sep=;` of Excel.
_SEPARATOR_LINE = re.compile(r'\s*"?sep=([^"\s]|\t)"?[\s,;]*', re.IGNORECASE)
_UNITS = {"deg", "°", "g", "mg", "m/s2", "m/s^2", "m/s²", "s", "ms", "degC", "°C", "C", "1"}
_NUMBER = re.compile(r"\s*[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?\s*")
# Number of lines that determine the layout: separator line of Excel, header, first row.
_BEGINNING = 3

Lines = Sequence[tuple[int, str]]


def readings_among(names: Sequence[str]) -> bool:
    """Whether these are columns of a table of readings."""
    return any(all(f"a{axis}_{unit}" in names for axis in AXES) for unit in UNITS)


def named_layout(path: Path) -> tuple[TextLayout, list[tuple[int, str]]]:
    """The layout of a table, and all comments with their lines.

    **Raises:** `InputError` for a file that is not text, has no line of names, has rows marked as comments, or has a last
    line that may be truncated.
    """
    beginning, comments, count = [], [], 0
    for before, text in decoded_pieces(path):
        count = before + text.count("\n") + (not text.endswith("\n"))
        if len(beginning) < _BEGINNING or "#" in text:
            rows, found = parted(text.removesuffix("\n").split("\n"), before + 1)
            comments += found
            beginning.extend(islice(rows, _BEGINNING - len(beginning)))
    if not beginning and not comments:
        raise InputError(f"{path}: the file is empty")
    layout = layout_of_lines(path, beginning, comments)
    comments = [comment for comment in comments if comment[0] != layout.header_line]
    # No reading is lost behind a mark of comments.
    hidden = [(line, cells_of(text, layout.separator)) for line, text in comments if line >= layout.first_line]
    if faults := [
        f"{path}:line {line}: begins with # like a comment, but is a row of numbers; write {shown(cells[0].strip('# '))} "
        "without the #, or, to omit the row, '# left out:' before it"
        for line, cells in hidden
        if len(cells) == len(layout.names) > 3 and ":" not in cells[0] and _of_numbers(cells[1:])
    ]:
        raise InputError(faults)
    if count >= layout.first_line and (cells := layout.cut_row()):
        column = f", column {layout.names[len(cells) - 1]}" if len(cells) <= len(layout.names) else ""
        raise InputError(
            f"{path}:line {count}{column}: the last line has no line end, and {shown(cells[-1])} is shorter than in other "
            "rows, so it may be truncated; complete the row and its line end, or remove it"
        )
    return layout, comments


def parted(lines: Sequence[str], first: int = 1) -> tuple[Lines, Lines]:
    """Lines that are neither blank nor comments, and the comments, with their numbers from `first` on."""
    numbered = [(k, line, comment_in(line)) for k, line in enumerate(lines, first) if not is_blank(line)]
    return [(k, line) for k, line, text in numbered if text is None], [(k, text) for k, _, text in numbered if text]


def layout_of_lines(path: Path, beginning: Lines, comments: Lines = ()) -> TextLayout:
    """The layout of a table from its first lines, with unconverted cells.

    A header may be a comment, as numpy writes it, if it names readings and numbers follow.

    **Arguments:**

    - `beginning`: the first lines with their numbers, neither blank nor comments; three of them suffice.
    - `comments`: comment lines with their numbers.

    **Raises:** `InputError` if no line names the columns.
    """
    stated = _SEPARATOR_LINE.fullmatch(beginning[0][1]) if beginning else None
    if stated and stated[1] not in ",;\t|":
        words = f"{shown(stated[1])} as separator; write the columns with commas, semicolons, tabs or pipes"
        raise InputError(f"{path}:line {beginning[0][0]}: {words}")
    beginning = beginning[1:] if stated else beginning
    if not beginning:
        raise InputError(f"{path}: no header line; the first line names the columns")
    line, text = beginning[0]
    for number, comment in reversed([comment for comment in comments if comment[0] < line]):
        header = comment.lstrip("# ")
        separator = stated[1] if stated else _separator(header)
        names, cells = cells_of(header, separator), cells_of(text, separator)
        if readings_among(names) and len(cells) == len(names) and _of_numbers(cells):
            return TextLayout(path, tuple(names), separator, number, line)
    separator = stated[1] if stated else _separator(text)
    names = cells_of(text, separator)
    if b'"' in unquoted(text.encode(), separator):
        raise InputError(f"{path}:line {line}: quotation marks within a name; check the quotation marks")
    # A title, or the groups of a header in two lines.
    number, below = beginning[1] if len(beginning) > 1 else (0, "")
    next_names = [cell for cell in cells_of(below, _separator(below)) if cell]
    fewer = sum(map(bool, names)) == 1 and len(next_names) > 2
    known, known_below = (sum(name in KNOWN for name in some) for some in (names, next_names))
    if not any(map(_NUMBER.fullmatch, next_names)) and (fewer or known_below > max(2, known)):
        words = f"is not a header: line {number} names the columns; write # before line {line}"
        raise InputError(f"{path}:line {line}: {shown(text.rstrip(',;| '))} {words}")
    if _of_numbers(names):
        raise InputError(
            f"{path}:line {line}: numbers instead of the names of the columns; write the names in the first line that is not "
            "a comment, such as position,alpha_deg,beta_deg,ax_g,ay_g,az_g"
        )
    return TextLayout(path, tuple(names), separator, line, line + 1)


def _separator(header: str) -> str:
    """The separator of the columns: a comma, or a semicolon, a tab or a pipe if a header has more of them."""
    return max(",;\t|", key=header.count)


def require_different(layout: TextLayout, names: Sequence[str]) -> None:
    """Reject names of several columns.

    **Raises:** `InputError` with each of them.
    """
    if faults := [
        f"{layout.path}:line {layout.header_line}, column {name or '(no name)'}: the column is given twice; keep one"
        for name in sorted({name for name in names if names.count(name) > 1})
    ]:
        raise InputError(faults)


def row_words(cells: Sequence[str], names: Sequence[str]) -> str:
    """The fault of the cells of a line as a row below these names; "" if there is none."""
    if [cell.strip() for cell in cells] == list(names):
        return "the names of the columns again; remove the line"
    written = [cell.strip().strip("[]()") for cell in cells if cell.strip(" -")]
    if len(written) > 1 and set(written) <= _UNITS:
        return "a line of units, not a row; write # before it: the names of the columns state the units"
    if len(cells) == len(names):
        return ""
    cure = "remove the row" if len(cells) > len(names) else "complete the row or remove it"
    return f"{counted(len(cells), 'cell')}, but the header has {len(names)}; {cure}"


def _of_numbers(cells: Sequence[str]) -> bool:
    """Whether most cells are numbers, so that this is not a header."""
    return 2 * sum(bool(_NUMBER.fullmatch(cell)) for cell in cells) > len(cells)
