"""Text: rows between separators, or lines with words around their numbers; what the lines before the rows state."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NoReturn

import polars as pl

from tumblecal.data.files import stated
from tumblecal.data.line_form import FORM_SEPARATOR, LineForm, clock_form, has_words, without_clock, word_forms
from tumblecal.data.text_cells import numbers_in, row_of, separator_of
from tumblecal.data.text_layout import SEPARATORS, TextLayout
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import EMPTY_CELLS, comment_in, is_utf16, opened, shown
from tumblecal.data.column_names import role_of
from tumblecal.recordings.table import Reader, Source, Table


_HEAD, _LINES, _FEWEST_LINES, _TEXT_SHARE = 1 << 16, 200, 2, 0.95
_MOST_KINDS = 20
# A line before the rows with a name and a value: // Update Rate: 100.0Hz.
_STATED = re.compile(r"[\W_]*([A-Za-z][\w .\-/()]{0,40}?)\s*[:=]\s*(\S.{0,200}?)\s*")
_RATE = re.compile(r"\bat\s+(\d+(?:\.\d+)?)\s*Hz\b")
_LABEL = re.compile(r"\W*(headers?|columns?|cols?|fields?|names?)\W*", re.IGNORECASE)
# Columns of files without names, by a line of the preamble.
_KNOWN = {
    "Device Type,GENEActiv": ("time", "x (g)", "y (g)", "z (g)", "light (lux)", "button", "temperature (degC)"),
}  # fmt: skip
_ROLES = {"SampleTimeFine": "time_100us"}
_BY_NUMBER = "or give the columns by number: --columns time=1,ax=2,ay=3,az=4"


def _is_text(path: Path, head: bytes) -> bool:
    if is_utf16(head):
        return True
    text = decoded(head[:4096].rsplit(b"\n", 1)[0])
    usual = sum(letter in "\t\r\n" or letter.isprintable() for letter in text)
    return b"\x00" not in head and usual > _TEXT_SHARE * len(text)


def decoded(raw: bytes) -> str:
    """A line of text, as UTF-8 or otherwise in the Western European encoding of spreadsheets."""
    try:
        return raw.decode("utf-8-sig").rstrip("\r\n")
    except UnicodeDecodeError:
        return raw.decode("cp1252", "replace").rstrip("\r\n")


def _read(source: Source) -> list[Table]:
    """The tables of a text: one, or one for each kind of row.

    **Raises:** `InputError` if there are no rows of three numbers, or the header does not fit the rows.
    """
    path = source.path
    written = _first_lines(path)
    body = [line for line in written if line.strip() and comment_in(line) is None]
    # Lines from the middle show the layout: preambles come first, and the last line may be torn.
    middle = body[len(body) // 2 :][:_LINES]
    plain = without_clock(middle)
    separator = separator_of(plain or middle)
    clock = clock_form(separator) if plain else None
    if kinds := _kinds_of(middle, separator):
        return [text_table(source, *_of_kind(path, written, kind, separator), name=kind.lstrip("$")) for kind in kinds]
    lines = [clock.line(line) for line in written] if clock else written
    rows = [[] if comment_in(line) is not None else row_of(line, separator) for line in lines]
    widths = Counter(len(row) for row in rows if numbers_in(row) >= 3)
    found = bool(widths) and max(widths.values()) >= min(_FEWEST_LINES, len(body) - 1)
    width = _width(lines, rows, separator, widths.most_common(1)[0][0]) if found else 0
    first = next((k for k, row in enumerate(rows) if len(row) in (width, width - 1) and numbers_in(row) >= 3), len(rows)) if found else 0
    names, header = _header(source, written[:first], separator, width, clock is not None) if found else ((), None)
    if not found and (table := _of_axes(source, rows, separator)):
        return [table]
    if (not found or (header is None and not clock and _labelled(rows, width))) and (forms := word_forms(middle)):
        many = len(forms) > 1
        return [text_table(source, *_of_form(path, written, form), name=name if many else "") for name, form in forms.items()]
    if not found:
        _refuse(path, body, separator)
    layout = TextLayout(path, names, separator, ("",) * width, header, first + 1, clock)
    _check_marks(path, [row for row in rows if len(row) == width and numbers_in(row) >= 3], first, separator)
    return [text_table(source, layout, _statements(written[:first], separator) | stated(written))]


def _first_lines(path: Path) -> list[str]:
    with opened(path) as file:
        head = file.read(_HEAD)
    lines = head.splitlines(keepends=True)
    if len(head) == _HEAD and len(lines) < 2:
        raise InputError(
            f"{path}: its first line is longer than {_HEAD >> 10} kB, so it is not a table of samples; give the original log"
        )
    return [decoded(raw) for raw in (lines if len(head) < _HEAD else lines[:-1])]


def text_table(
    source: Source, layout: TextLayout, statements: Mapping[str, str], name: str = "", roles: Mapping[str, str] = _ROLES
) -> Table:
    """The rows of a text with this layout; all cells are text. `roles`: quantities of some columns."""

    def pieces(columns: Sequence[str]) -> Iterator[pl.DataFrame]:
        return layout.frames(
            columns, cut=lambda line: source.damage.report(f"line {line} has no end and may be truncated: left out")
        )

    decimal = source.options.decimal
    if decimal not in ("", "comma", "point", ",", "."):
        raise InputError(f"--decimal {decimal}: write point or comma")
    with_commas = decimal in ("comma", ",") or (not decimal and layout.separator in ";\t|" + FORM_SEPARATOR and _has_commas(layout))
    return Table(
        *(name, layout.names, pieces),
        stated=statements,
        words=layout.words() + (", decimal comma" if with_commas else ""),
        row_word="line",
        header=layout.header_line,
        sheet=layout.header_line is not None,
        roles={name: role for name, role in roles.items() if name in layout.names},
        decimal="," if with_commas else ".",
    )


def _has_commas(layout: TextLayout) -> bool:
    """Whether cells have numbers with commas."""
    frame = next(layout.frames(layout.names)).head(_LINES)
    return any(frame[name].str.contains(r"^[+-]?\d*,\d+(?:[eE][+-]?\d+)?$").any() for name in layout.names)


def _width(lines: Sequence[str], rows: list[list[str]], separator: str, width: int) -> int:
    """Cells of a row, with a last one that is empty in all rows if a line above names its column."""
    named = {len(row) for row in rows if any(role_of(cell)[0] for cell in row)}
    ends = [line.rstrip(" ").endswith(separator) for line, row in zip(lines, rows, strict=True) if len(row) == width and numbers_in(row) >= 3]
    return width + 1 if width not in named and width + 1 in named and separator != " " and all(ends) else width


def _header(source: Source, before: Sequence[str], separator: str, width: int, clock: bool) -> tuple[tuple[str, ...], int | None]:
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
                raise InputError(f"{source.path}:line {number}, column {twice[0]}: this name occurs twice; remove one, {_BY_NUMBER}")
            return tuple(names), number
        if number == numbered[-1][0] and known and len(names) > 2 and not numbers_in(names) and not source.options.columns:
            if separator == "," and width == 2 * len(names):
                raise InputError(f"{source.path}:line {number}: {_COMMAS}")
            raise InputError(
                f"{source.path}:line {number}: names {len(names)} columns, but the rows have {width} cells; correct the header "
                f"line, {_BY_NUMBER}"
            )
    return by_number, None


_COMMAS = "commas between cells are indistinguishable from decimal commas; write decimal points, or semicolons between cells"


def _check_marks(path: Path, rows: list[list[str]], first: int, separator: str) -> None:
    """Raise for rows in which every second cell has digits with leading zeros, as in 0,0100,9,8067."""
    if separator != "," or not rows or len(rows[0]) % 2:
        return
    fractions = [[row[k] for row in rows] for k in range(1, len(rows[0]), 2)]
    if all(all(map(str.isdecimal, cells)) and any(re.match(r"0\d", cell) for cell in cells) for cells in fractions):
        raise InputError(f"{path}:line {first + 1}: {','.join(rows[0])[:60]!r}: {_COMMAS}")


def _statements(before: Sequence[str], separator: str) -> dict[str, str]:
    """Values that lines before the rows state: comments, lines of a name and a value, and cells of a name and a value."""
    found: dict[str, str] = {}
    for line in before:
        cells = [cell for cell in row_of(line.lstrip("#%;/ "), separator) if cell]
        if match := _RATE.search(line):
            found["rate_hz"] = match[1]
        if match := _STATED.fullmatch(line) if not line.startswith(("#", '"#')) else None:
            found[_key(match[1])] = match[2].strip(EMPTY_CELLS)
        elif len(cells) in (2, 3) and not numbers_in(cells[:1]):
            found[_key(cells[0])] = cells[1]
    return found | stated(before)


def _key(text: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", text.strip(" :")).lower().replace(" ", "_")


def _kinds_of(middle: Sequence[str], separator: str) -> list[str]:
    """The first cells of rows of several kinds, most frequent first; none if the rows are of one kind."""
    rows = [row_of(line, separator) for line in middle]
    rows = [row for row in rows if numbers_in(row[1:]) >= 2 and re.match(r"\$?[A-Za-z]", row[0])]
    kinds = Counter(row[0] for row in rows)
    widths = {(row[0], len(row)) for row in rows}
    alike = len(widths) == len(kinds) and len({width for _, width in widths}) > 1
    return [kind for kind, _ in kinds.most_common()] if alike and 2 * len(rows) > len(middle) and 2 <= len(kinds) <= _MOST_KINDS else []


def _of_kind(path: Path, written: Sequence[str], kind: str, separator: str) -> tuple[TextLayout, dict[str, str]]:
    """The layout of the rows that begin with this cell; lines with the kind in a later cell name its columns, then its units."""
    rows = [row_of(line, separator) for line in written]
    first = next(k for k, row in enumerate(rows) if row[:1] == [kind])
    width = len(rows[first]) - 1
    above = [row[row.index(kind.lstrip("$")) + 1 :] for row in rows[:first] if kind.lstrip("$") in row[1:]]
    names = next((row for row in above if len(row) == width), [str(k + 1) for k in range(width)])
    units = [row for row in above if len(row) == width][1:2]
    names = [f"{name} ({unit})" for name, unit in zip(names, *units, strict=True)] if units else names
    mark, between = re.escape(kind.encode()), re.escape(separator.encode())
    form = LineForm(re.compile(rb"^" + mark + between, re.MULTILINE), b"", (), re.compile(rb"^(?!" + mark + between + rb").*$", re.MULTILINE))
    layout = TextLayout(path, tuple(names), separator, ("",) * width, None, first + 1, form)
    return layout, _statements(written[:first], separator)


def _of_form(path: Path, written: Sequence[str], form: LineForm) -> tuple[TextLayout, dict[str, str]]:
    first = next(k for k, line in enumerate(written) if form.pattern.match(line.encode()))
    layout = TextLayout(path, form.names, FORM_SEPARATOR, ("",) * len(form.names), None, first + 1, form)
    return layout, _statements(written[:first], FORM_SEPARATOR)


def _labelled(rows: Sequence[list[str]], width: int) -> bool:
    """Whether numbers have words around them, or names of quantities between them."""
    good = [row for row in rows if len(row) == width]
    return has_words(good) or any(len({*cells}) == 1 and role_of(cells[0])[0] for cells in zip(*good, strict=True))


def _of_axes(source: Source, rows: Sequence[list[str]], separator: str) -> Table | None:
    """A table with a row for each axis, as one with a column for each; None for other text."""
    widths = Counter(map(len, rows))
    width = widths.most_common(1)[0][0] if widths else 0
    good = [row for row in rows if len(row) == width]
    axes = [k for k in range(width) if {row[k].lower() for row in good[1:]} == {"x", "y", "z"}]
    values = [k for k in range(width) if len(good) > 1 and numbers_in([row[k] for row in good[1:]]) == len(good) - 1]
    if len(axes) != 1 or not values or numbers_in(good[0]):
        return None
    layout = TextLayout(source.path, tuple(good[0]), separator, ("",) * width, 1, 2)
    axis, value = good[0][axes[0]], good[0][values[-1]]
    keys = [name for name in good[0] if name not in (axis, value)]
    frame = pl.concat(layout.frames(good[0])).with_columns(pl.col(axis).str.to_lowercase())
    wide = frame.pivot(on=axis, index=keys, values=value, aggregate_function="first")
    sensor = " ".join(str(frame[name][0]) for name in keys if frame[name].n_unique() == 1)
    wide = wide.rename({letter: f"{sensor} {letter}".strip() for letter in "xyz"})
    return Table("", tuple(wide.columns), lambda columns: iter([wide.select(columns)]), len(wide), words="text, a row for each axis")


def _refuse(path: Path, body: Sequence[str], separator: str) -> NoReturn:
    first = body[0] if body else ""
    cells = row_of(first, separator)
    if len(body) == 1 and any(role_of(cell)[0] for cell in cells):
        raise InputError(f"{path}: no rows below the header {first[:60]!r}; give the whole recording")
    if first.lstrip().startswith("<"):
        raise InputError(f"{path}: this is HTML or XML, not a table; export the samples as CSV")
    raise InputError(
        f"{path}: text without rows of three or more numbers; its first line {shown(first)} has "
        f"{counted(len(cells), 'cell')} separated by {SEPARATORS[separator]}, {numbers_in(cells)} of them numbers: write the "
        "three accelerations of a sample in one line; for the bytes of a device give --protocol"
    )


READER = Reader("text", _is_text, _read, rank=2)
