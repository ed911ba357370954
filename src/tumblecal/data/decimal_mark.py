"""One decimal mark for a whole file, where spreadsheets wrote it with semicolons or tabs: 0,5 or 0.5, 1.200 or 1,200.

A cell such as 1.200 may be either. It is a decimal in columns that never reach a thousand, and where other cells show the
point to be the decimal mark; it is 1200 where they show the comma to be, or nothing does, and numbers of less than a thousand
stand beside it without a mark. All else is refused.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from tumblecal.data.table import KNOWN, LABELS, Table
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown


if TYPE_CHECKING:
    import polars as pl

OTHER = {",": ".", ".": ","}
_WORDS = {",": "comma", ".": "point"}
# How numbers are written that may have either mark: only in columns that reach a thousand, and 100 g are no reading.
_READING = r"[1-9]\d?[.,]\d{3}"
_DOUBTFUL = {
    name: re.compile(shape)
    for name, shape in {
        **dict.fromkeys(("time_s", "n"), r"[1-9]\d{0,2}[.,]\d{3}"),
        **dict.fromkeys(("ax_mg", "ay_mg", "az_mg"), _READING),
    }.items()
}
_NUMBER = re.compile(r"[+-]?([\d.,]*\d[\d.,]*)([eE][+-]?\d+)?")
_GROUPED = {mark: re.compile(rf"\d{{1,3}}(\{mark}\d{{3}})+(\{OTHER[mark]}\d*)?") for mark in OTHER}
_MOST_FAULTS = 20


@dataclass(frozen=True)
class _Mark:
    """What a cell tells of the marks: the `decimal` one, whether it groups thousands, or its mark that may be either."""

    decimal: str | None = None
    grouped: bool = False
    doubtful: str | None = None


def decimal_mark(table: Table) -> str | None:
    """The decimal mark of a table's numbers; None where no cell tells it.

    **Raises:** `InputError` naming two cells with different marks.
    """
    first: dict[str, tuple[int, str]] = {}
    count = dict.fromkeys(OTHER, 0)
    for name in _numeric(table):
        for row, cell in enumerate(table.columns[name]):
            if mark := _mark(cell, name).decimal:
                first.setdefault(mark, (row, name))
                count[mark] += 1
    if len(first) == 2:
        rarer, usual = sorted(first, key=count.__getitem__)
        (row, name), (other_row, other) = first[rarer], first[usual]
        there = f"{table.row_word} {table.lines[other_row]}, column {other}"
        raise InputError(
            f"{table.place(row, name)}: {shown(table.columns[name][row])} has a decimal {_WORDS[rarer]}, but "
            f"{shown(table.columns[other][other_row])} ({there}) a decimal {_WORDS[usual]}; write one of them throughout"
        )
    return next(iter(first), None)


def with_points(table: Table) -> Table:
    """The table with decimal points and without thousands separators; what is no number stays as it is.

    **Raises:** `InputError` as `decimal_mark` does, and naming each cell whose mark may be either.
    """
    mark = decimal_mark(table)
    doubtful = {name: _doubtful(name, table.columns[name]) for name in _numeric(table)}
    both = mark is None and len(set().union(*doubtful.values())) > 1
    plain, faults = dict[str, list[object]](), list[str]()
    for name in _numeric(table):
        cells, own = table.columns[name], doubtful[name]
        if own - {mark} and (both or not _groups_thousands(name, cells, mark)):
            rows = [row for row, cell in enumerate(cells) if _mark(cell, name).doubtful not in (None, mark)]
            faults += [f"{table.place(row, name)}: {either_words(str(cells[row]).strip(), mark)}" for row in rows]
        decimal = mark or (OTHER[min(own)] if own else ".")
        plain[name] = [_with_point(cell, name, decimal) for cell in cells]
    if faults:
        raise InputError(faults[:_MOST_FAULTS])
    return replace(table, columns={**table.columns, **plain})


def may_be_thousands(cell: str, separator: str, mark: str | None) -> bool:
    """Whether a cell's only mark is another than a file's decimal one, so that it may separate thousands."""
    digits = cell.strip().lstrip("+-")
    shaped = separator != "," and re.fullmatch(r"[1-9]\d{0,2}[.,]\d{3}", digits)
    return bool(shaped) and (mark is None or mark not in digits)


def either_words(cell: str, mark: str | None) -> str:
    """That a number such as 1.200 may be two, beside the decimal `mark` of a file or where none is known."""
    own = next(own for own in OTHER if own in cell)
    plain = cell.replace(own, "")
    beside = f" beside decimal {_WORDS[mark]}s" if mark else ""
    decimal = f"{cell.replace(own, mark)}" if mark else f"{cell}0"
    return f"{shown(cell)}{beside} may be {plain} or {cell.replace(own, '.')}; write {plain} or {decimal}"


def points_in(cells: "pl.Series", mark: str | None) -> "pl.Series":
    """Text of numbers with decimal points in place of a file's `mark`; None where the other mark may be a decimal one.

    Where no reading tells the mark, it is a point; readings that may be thousands become None.
    """
    if mark is None:
        if not cells.name.endswith("_mg"):
            return cells
        return cells.set(cells.str.contains(rf"^[+-]?{_READING}$").fill_null(False), None)
    other = OTHER[mark]
    marked = cells.str.contains(other, literal=True).fill_null(False)
    if marked.any():
        grouped = cells.str.contains(rf"^[+-]?\d{{1,3}}(\{other}\d{{3}})+\{mark}\d*$").fill_null(False)
        cells = cells.set(marked & ~grouped, None).str.replace_all(other, "", literal=True)
    return cells.str.replace(mark, ".", literal=True) if mark == "," else cells


def _numeric(table: Table) -> list[str]:
    return [name for name in table.columns if name in KNOWN and name not in LABELS]


def _mark(cell: object, name: str) -> _Mark:
    match = _NUMBER.fullmatch(cell.strip()) if isinstance(cell, str) else None
    if match is None:
        return _Mark()
    digits = match[1]
    marks = {mark for mark in OTHER if mark in digits}
    if len(marks) == 2:
        last = max(marks, key=digits.rindex)
        return _Mark(last, grouped=True) if _GROUPED[OTHER[last]].fullmatch(digits) else _Mark()
    if not marks:
        return _Mark()
    (mark,) = marks
    if digits.count(mark) > 1:
        return _Mark(OTHER[mark], grouped=True) if _GROUPED[mark].fullmatch(digits) else _Mark()
    doubtful = name in _DOUBTFUL and not match[2] and _DOUBTFUL[name].fullmatch(digits)
    return _Mark(doubtful=mark) if doubtful else _Mark(mark)


def _doubtful(name: str, cells: Sequence[object]) -> set[str]:
    """The marks of a column's cells that may be either."""
    return {mark for cell in cells if (mark := _mark(cell, name).doubtful)}


def _groups_thousands(name: str, cells: Sequence[object], mark: str | None) -> bool:
    """Whether the mark of a column's doubtful cells is beyond doubt a thousands separator."""
    if mark and (name == "n" or any(_mark(cell, name).grouped for cell in cells)):
        return True
    unmarked = [cell.strip().lstrip("+-") for cell in cells if isinstance(cell, str)]
    sizes = [int(digits) for digits in unmarked if digits.isascii() and digits.isdigit() and len(digits) < 10]
    return bool(sizes) and max(sizes) < 1000


def _with_point(cell: object, name: str, decimal: str) -> object:
    if not isinstance(cell, str) or not _NUMBER.fullmatch(cell.strip()) or _mark(cell, name) == _Mark():
        return cell
    return cell.strip().replace(OTHER[decimal], "").replace(",", ".")
