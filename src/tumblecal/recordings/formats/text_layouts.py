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
_RATE = re.compile(
    r"\b(?:at|(?:data|output|sample|sampling|update)[ _]rate)\W{1,3}(\d+(?:\.\d+)?)\s*Hz\b", re.IGNORECASE
)
_LABEL = re.compile(r"\W*(headers?|columns?|cols?|fields?|names?)\W*", re.IGNORECASE)
# Columns of files without names, by a line of the preamble.
_KNOWN = {
    "Device Type,GENEActiv": ("time", "x (g)", "y (g)", "z (g)", "light (lux)", "button", "temperature (degC)"),
}  # fmt: skip
# Quantities that no other column replaces if two columns have the same name.
_NEEDED = (*FORCE, *RATE, "time")
_COMMAS = (
    "write decimal points, or semicolons between cells: commas between cells are indistinguishable from decimal commas"
)


def header_of(
    source: Source, before: Sequence[str], separator: str, width: int, filled: int, *, clock: bool
) -> tuple[tuple[str, ...], int | None]:
    """Names of the columns, with the units of a line below them, and the last of these lines; numbers if no line has names.

    **Arguments:**

    - `width`: cells of a row. `filled`: of these up to the last one that is not empty in all rows; the others need no name.

    **Raises:** `InputError` for a line that names more or fewer columns than the rows have, or one name for two accelerations
    or clocks, unless the user gives the columns by number. Other columns with one name for several have their numbers instead.
    """
    for line, names in _KNOWN.items():
        if any(text.startswith(line) for text in before) and len(names) == width:
            return names, None
    units, last = list[str](), 0
    for number, line in reversed([(number, line) for number, line in enumerate(before, 1) if line.strip()][-3:]):
        text = ((clock and without_clock([line])) or [line])[0].lstrip("#%;/ ")
        names = row_of(text, separator)
        if len(names) != width and separator == " ":
            names = row_of(text, separator_of([text]))
        roles = [role_of(name) for name in names]
        if clock and len(names) == width - 1:
            names = ["monitor" if "time" in dict(roles) or "T" in names else "time", *names]
        elif len(names) == width + 1 and _LABEL.fullmatch(names[0]):
            names = names[1:]
        elif len(names) == width + 1 and names[-1] == "Comment":
            names = names[:-1]
        if not last and are_units(names):
            units, last = names, number
            continue
        if filled <= len(names) < width:
            names = [*names, *[""] * (width - len(names))]
        fits = len(names) == width and numbers_in(names) < 3
        unclear = [
            bool(numbers_in([name])) or (names.count(name) > 1 and role_of(name)[0] not in _NEEDED) for name in names
        ]
        names = ["" if left_out else name for left_out, name in zip(unclear, names, strict=True)]
        twice = [name for name in names if name and names.count(name) > 1]
        if fits and not twice and any(re.search(r"[^\W\d_]", name) for name in names):
            return with_line_of_units([name or str(k) for k, name in enumerate(names, 1)], units), max(number, last)
        if any(role for role, _ in roles) and len(names) > 2 and not numbers_in(names) and not source.options.columns:
            what = (
                f"column {twice[0]}: this name occurs twice"
                if fits
                else f"names {len(names)} columns, but the rows have {width} cells"
            )
            cure = f"correct the header line, or give the columns by number: {_by_number(names if fits else [])}"
            cure = _COMMAS if separator == "," and width == 2 * len(names) else cure
            raise InputError(f"{source.path}:line {number}: {what}; {cure}")
    # Without names above them, words such as t, a, b are names instead of units.
    if len({*units}) == width:
        return tuple(units), last
    return (*(("time",) if clock else ()), *map(str, range(1 + clock, width + 1))), None


def _by_number(names: Sequence[str]) -> str:
    """The option that gives the columns by number, with the units of their names, or an example of it."""
    roles = [(*role_of(name), number) for number, name in enumerate(names, start=1)]
    columns = {role: f"{role}_{unit}={number}".replace("_=", "=") for role, unit, number in reversed(roles) if role}
    known = ",".join(columns[role] for role in ("time", *FORCE, *RATE) if role in columns)
    return f"--columns {known}" if {*FORCE} <= {*columns} else COLUMNS_OPTION


def are_units(cells: Sequence[str]) -> bool:
    """Whether most cells that are not empty are units, with or without brackets."""
    return 2 * sum(map(bool, map(_unit, cells))) > sum(map(bool, cells)) > 1


def with_line_of_units(names: Sequence[str], units: Sequence[str]) -> tuple[str, ...]:
    """Names with the units of a line below them, which may end earlier; other words of that line are ignored."""
    brackets = [f" ({unit})" if (unit := _unit(cell)) else "" for cell in units]
    return tuple(name + unit for name, unit in zip(names, [*brackets, *[""] * len(names)], strict=False))


def _unit(cell: str) -> str:
    """A unit without brackets around it; empty for no unit."""
    unit = re.sub(r"^[\[(](.*)[\])]$", r"\1", cell.strip())
    return unit if unit_of(unit) else ""


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
    names = with_line_of_units(above[0], above[1] if len(above) > 1 else ())
    layout = TextLayout(path, names, separator, None, first + 1, form)
    return layout, statements_in(written[:first], separator)
