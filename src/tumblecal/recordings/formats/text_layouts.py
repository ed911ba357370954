"""The layout of a text by its first lines: names and units of the columns, statements, kinds of rows, words around numbers."""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tumblecal.data.column_names import FORCE, RATE, role_of, unit_of
from tumblecal.data.files import stated
from tumblecal.data.line_form import LineForm, without_clock
from tumblecal.data.text_cells import numbers_in, row_of, separator_of
from tumblecal.data.text_layout import TextLayout
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import EMPTY_CELLS, comment_in
from tumblecal.recordings.columns import COLUMNS_OPTION
from tumblecal.recordings.table import Source


_MOST_KINDS = 20
# A line before the rows with a name and a value: // Update Rate: 100.0Hz.
_STATED = re.compile(r"[\W_]*([A-Za-z][\w .\-/()]{0,40}?)\s*[:=]\s*(\S.{0,200}?)\s*")
_RATE = re.compile(r"\bat\s+(\d+(?:\.\d+)?)\s*Hz\b")
_LABEL = re.compile(r"\W*(headers?|columns?|cols?|fields?|names?)\W*", re.IGNORECASE)
# Columns of files without names, by a line of the preamble.
_KNOWN = {
    "Device Type,GENEActiv": ("time", "x (g)", "y (g)", "z (g)", "light (lux)", "button", "temperature (degC)"),
}  # fmt: skip
_COMMAS = "write decimal points, or semicolons between cells: commas between cells are indistinguishable from decimal commas"


def header_of(
    source: Source, before: Sequence[str], separator: str, width: int, *, clock: bool
) -> tuple[tuple[str, ...], int | None]:
    """Names of the columns, with the units of a line below them, and the last of these lines; numbers if no line has names.

    **Raises:** `InputError` for a line that names more or fewer columns than the rows have, or one of them twice, unless
    the user gives the columns by number.
    """
    for line, names in _KNOWN.items():
        if any(text.startswith(line) for text in before) and len(names) == width:
            return names, None
    numbered = [(number, line) for number, line in enumerate(before, start=1) if line.strip()][-3:]
    last, units = len(before), list[str]()
    for number, line in reversed(numbered):
        text = ((clock and without_clock([line])) or [line])[0].lstrip("#%;/ ")
        names = row_of(text, separator)
        if len(names) != width and separator == " ":
            names = row_of(text, separator_of([text]))
        if clock and len(names) == width - 1:
            names = ["monitor" if {"time", "t", "T"} & {role_of(name)[0] or name for name in names} else "time", *names]
        if len(names) == width + 1 and _LABEL.fullmatch(names[0]):
            names = names[1:]
        if not units and are_units(names):
            last, units = number, names
            continue
        fault = _fault(names, width, separator)
        if fault and known_names(names) and not source.options.columns and (number, line) == numbered[-1 - bool(units)]:
            raise InputError(f"{source.path}:line {number}{fault}")
        if not fault and any(re.search(r"[^\W\d_]", name) for name in names):
            return with_units([name or str(k) for k, name in enumerate(names, 1)], units), max(number, last if units else 0)
    return (*(("time",) if clock else ()), *map(str, range(1 + clock, width + 1))), None


def known_names(cells: Sequence[str]) -> bool:
    """Whether some cells name a quantity."""
    return any(role_of(cell)[0] for cell in cells)


def are_units(cells: Sequence[str]) -> bool:
    """Whether all cells that are not empty are units, with or without brackets."""
    return len(cells) > 2 and any(cells) and all(unit_of(cell.strip("[]() ")) for cell in cells if cell)


def with_units(names: Sequence[str], units: Sequence[str]) -> tuple[str, ...]:
    """Names with the units of a line below them, which may end earlier."""
    brackets = [f" [{unit.strip('[]() ')}]" if unit else "" for unit in units]
    return tuple(name + unit for name, unit in zip(names, [*brackets, *[""] * len(names)], strict=False))


def _fault(names: Sequence[str], width: int, separator: str) -> str:
    """What is wrong with the names of the columns, with its remedy; empty for names."""
    roles = {"_".join(filter(None, role_of(name))): number for number, name in reversed([*enumerate(names, start=1)])}
    by_role = {role.partition("_")[0]: f"{role}={number}" for role, number in roles.items()}
    known = ",".join(by_role[role] for role in ("time", *FORCE, *RATE) if role in by_role)
    option = f"--columns {known}" if len(names) == width and {*FORCE} <= {*by_role} else COLUMNS_OPTION
    twice = [name for name in names if name and names.count(name) > 1]
    if len(names) == width and numbers_in(names) < 3 and twice:
        return f", column {twice[0]}: this name occurs twice; remove one, or give the columns by number: {option}"
    if len(names) == width or len(names) < 3 or numbers_in(names):
        return "" if len(names) == width and numbers_in(names) < 3 else ": no names"
    if separator == "," and width == 2 * len(names):
        return f": {_COMMAS}"
    words = f"names {len(names)} columns, but the rows have {width} cells; correct the header line"
    return f": {words}, or give the columns by number: {option}"


def statements_in(before: Sequence[str], separator: str) -> dict[str, str]:
    """Values that lines before the rows state: comments, lines of a name and a value, and cells of a name and a value."""
    found: dict[str, str] = {}
    for line in before:
        if match := _RATE.search(line):
            found["rate_hz"] = match[1]
        if comment_in(line) is not None:
            continue
        cells = [cell for cell in row_of(line.lstrip("#%;/ "), separator) if cell]
        name, value = cells[:2] if len(cells) in (2, 3) and not numbers_in(cells[:1]) else ("", "")
        if match := _STATED.fullmatch(line):
            name, value = match[1], match[2].strip(EMPTY_CELLS)
        if name:
            key = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name.strip(" :")).lower().replace(" ", "_")
            found[key] = value
    return found | stated(before)


def kinds_of(middle: Sequence[str], separator: str) -> list[str]:
    """The first cells of rows of several kinds, most frequent first; none if the rows are of one kind."""
    rows = [row_of(line, separator) for line in middle]
    rows = [row for row in rows if numbers_in(row[1:]) >= 2 and re.match(r"\$?[A-Za-z]", row[0])]
    kinds, widths = Counter(row[0] for row in rows), {(row[0], len(row)) for row in rows}
    one_width_each = len(widths) == len(kinds) and len({width for _, width in widths}) > 1
    most = 2 * len(rows) > len(middle) and 2 <= len(kinds) <= _MOST_KINDS
    return [kind for kind, _ in kinds.most_common()] if one_width_each and most else []


def layout_of_kind(path: Path, written: Sequence[str], kind: str, separator: str) -> tuple[TextLayout, dict[str, str]]:
    """The layout of the rows that begin with this cell; lines with it in a later cell name its columns, then its units."""
    rows, word = [row_of(line, separator) for line in written], kind.lstrip("$")
    first = next(k for k, row in enumerate(rows) if row[:1] == [kind])
    width = len(rows[first]) - 1
    above = [row[row.index(word) + 1 :] for row in rows[:first] if word in row[1:]]
    above = [row for row in above if len(row) == width] or [[str(k + 1) for k in range(width)]]
    begin = re.escape(f"{kind}{separator}".encode())
    others = re.compile(rb"^(?!" + begin + rb").*$", re.MULTILINE)
    form = LineForm(re.compile(rb"^" + begin, re.MULTILINE), b"", (), others)
    names = with_units(above[0], above[1] if len(above) > 1 else ())
    layout = TextLayout(path, names, separator, ("",) * width, None, first + 1, form)
    return layout, statements_in(written[:first], separator)
