"""The layout of a text by its first lines: names of the columns, statements, kinds of rows, words around numbers."""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tumblecal.data.column_names import FORCE, RATE, role_of
from tumblecal.data.files import stated
from tumblecal.data.line_form import FORM_SEPARATOR, LineForm, has_words, without_clock
from tumblecal.data.text_cells import numbers_in, row_of, separator_of
from tumblecal.data.text_layout import TextLayout
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import EMPTY_CELLS, comment_in
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
_COMMAS = (
    "commas between cells are indistinguishable from decimal commas; write decimal points, or semicolons between cells"
)


def row_width(lines: Sequence[str], rows: list[list[str]], separator: str, width: int) -> int:
    """Cells of a row, with a last one that is empty in all rows if a line above names its column."""
    named = {len(row) for row in rows if any(role_of(cell)[0] for cell in row)}
    ends = [
        line.rstrip(" ").endswith(separator)
        for line, row in zip(lines, rows, strict=True)
        if len(row) == width and numbers_in(row) >= 3
    ]
    return width + 1 if width not in named and width + 1 in named and separator != " " and all(ends) else width


def header_of(
    source: Source, before: Sequence[str], separator: str, width: int, clock: bool
) -> tuple[tuple[str, ...], int | None]:
    """Names of the columns and their line: the last line before the rows with as many names, or known ones; numbers if none.

    **Raises:** `InputError` for a line that names more or fewer columns than the rows have, or one of them twice, unless
    the user gives the columns by number.
    """
    by_number = (*(("time",) if clock else ()), *map(str, range(1 + clock, width + 1)))
    for line, names in _KNOWN.items():
        if any(text.startswith(line) for text in before) and len(names) == width:
            return names, None
    numbered = [(number, line) for number, line in enumerate(before, start=1) if line.strip()][-2:]
    for number, line in reversed(numbered):
        text = (without_clock([line]) or [line])[0] if clock else line
        text = text.lstrip("#%;/ ")
        names = row_of(text, separator)
        if len(names) != width and separator == " ":
            names = row_of(text, separator_of([text]))
        if clock and len(names) == width - 1:
            names = ["monitor" if {"time", "t", "T"} & {role_of(name)[0] or name for name in names} else "time", *names]
        if len(names) == width + 1 and _LABEL.fullmatch(names[0]):
            names = names[1:]
        known = any(role_of(name)[0] for name in names)
        if len(names) == width and any(re.search(r"[^\W\d_]", name) for name in names) and numbers_in(names) < 3:
            names = [name or str(k) for k, name in enumerate(names, start=1)]
            if twice := [name for name in names if names.count(name) > 1]:
                if not known or source.options.columns:
                    continue
                raise InputError(
                    f"{source.path}:line {number}, column {twice[0]}: this name occurs twice; remove one, "
                    f"{_by_number(names)}"
                )
            return tuple(names), number
        if (
            number == numbered[-1][0]
            and known
            and len(names) > 2
            and not numbers_in(names)
            and not source.options.columns
        ):
            if separator == "," and width == 2 * len(names):
                raise InputError(f"{source.path}:line {number}: {_COMMAS}")
            raise InputError(
                f"{source.path}:line {number}: names {len(names)} columns, but the rows have {width} cells; correct the header "
                f"line, {_by_number(names)}"
            )
    return by_number, None


def _by_number(names: Sequence[str]) -> str:
    """The option that gives the columns by number, with the units of their names, or an example of it."""
    roles = [(*role_of(name), number) for number, name in enumerate(names, start=1)]
    columns = {
        role: f"{'_'.join(filter(None, (role, unit)))}={number}" for role, unit, number in reversed(roles) if role
    }
    known = [columns[role] for role in ("time", *FORCE, *RATE) if role in columns]
    option = ",".join(known) if {*FORCE} <= {*columns} else "time=1,ax=2,ay=3,az=4"
    return f"or give the columns by number: --columns {option}"


def check_marks(path: Path, rows: list[list[str]], first: int, separator: str) -> None:
    """Raise for rows in which every second cell has digits with leading zeros, as in 0,0100,9,8067."""
    if separator != "," or not rows or len(rows[0]) % 2:
        return
    fractions = [[row[k] for row in rows] for k in range(1, len(rows[0]), 2)]
    if all(all(map(str.isdecimal, cells)) and any(re.match(r"0\d", cell) for cell in cells) for cells in fractions):
        raise InputError(f"{path}:line {first + 1}: {','.join(rows[0])[:60]!r}: {_COMMAS}")


def statements_in(before: Sequence[str], separator: str) -> dict[str, str]:
    """Values that lines before the rows state: comments, lines of a name and a value, and cells of a name and a value."""
    found: dict[str, str] = {}
    for line in before:
        if match := _RATE.search(line):
            found["rate_hz"] = match[1]
        if comment_in(line) is not None:
            continue
        cells = [cell for cell in row_of(line.lstrip("#%;/ "), separator) if cell]
        if match := _STATED.fullmatch(line):
            found[_key(match[1])] = match[2].strip(EMPTY_CELLS)
        elif len(cells) in (2, 3) and not numbers_in(cells[:1]):
            found[_key(cells[0])] = cells[1]
    return found | stated(before)


def _key(text: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", text.strip(" :")).lower().replace(" ", "_")


def kinds_of(middle: Sequence[str], separator: str) -> list[str]:
    """The first cells of rows of several kinds, most frequent first; none if the rows are of one kind."""
    rows = [row_of(line, separator) for line in middle]
    rows = [row for row in rows if numbers_in(row[1:]) >= 2 and re.match(r"\$?[A-Za-z]", row[0])]
    kinds = Counter(row[0] for row in rows)
    widths = {(row[0], len(row)) for row in rows}
    one_width_each = len(widths) == len(kinds) and len({width for _, width in widths}) > 1
    return (
        [kind for kind, _ in kinds.most_common()]
        if one_width_each and 2 * len(rows) > len(middle) and 2 <= len(kinds) <= _MOST_KINDS
        else []
    )


def layout_of_kind(path: Path, written: Sequence[str], kind: str, separator: str) -> tuple[TextLayout, dict[str, str]]:
    """The layout of the rows that begin with this cell; lines with it in a later cell name its columns, then its units."""
    rows = [row_of(line, separator) for line in written]
    first = next(k for k, row in enumerate(rows) if row[:1] == [kind])
    width = len(rows[first]) - 1
    above = [row[row.index(kind.lstrip("$")) + 1 :] for row in rows[:first] if kind.lstrip("$") in row[1:]]
    names = next((row for row in above if len(row) == width), [str(k + 1) for k in range(width)])
    units = [row for row in above if len(row) == width][1:2]
    names = [f"{name} ({unit})" for name, unit in zip(names, *units, strict=True)] if units else names
    mark, between = re.escape(kind.encode()), re.escape(separator.encode())
    form = LineForm(
        re.compile(rb"^" + mark + between, re.MULTILINE),
        b"",
        (),
        re.compile(rb"^(?!" + mark + between + rb").*$", re.MULTILINE),
    )
    layout = TextLayout(path, tuple(names), separator, ("",) * width, None, first + 1, form)
    return layout, statements_in(written[:first], separator)


def layout_of_form(path: Path, written: Sequence[str], form: LineForm) -> tuple[TextLayout, dict[str, str]]:
    """The layout of lines with words around their numbers."""
    first = next(k for k, line in enumerate(written) if form.pattern.match(line.encode()))
    layout = TextLayout(path, form.names, FORM_SEPARATOR, ("",) * len(form.names), None, first + 1, form)
    return layout, statements_in(written[:first], FORM_SEPARATOR)


def are_labelled(rows: Sequence[list[str]], width: int) -> bool:
    """Whether numbers have words around them, or names of quantities between them."""
    good = [row for row in rows if len(row) == width]
    return has_words(good) or any(len({*cells}) == 1 and role_of(cells[0])[0] for cells in zip(*good, strict=True))
