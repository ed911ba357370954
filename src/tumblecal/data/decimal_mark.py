"""One decimal mark for a whole file, where spreadsheets wrote it with semicolons or tabs: 0,5 or 0.5, 1.200 or 1,200.

A cell such as 1.200 may be either. It is a decimal in columns that never reach a thousand, and where other cells show the
point to be the decimal mark; it is 1200 where they show the comma to be, or nothing does, and numbers of less than a thousand
stand beside it without a mark. All else is refused.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from tumblecal.data.table import KNOWN, LABELS, Table
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown


OTHER = {",": ".", ".": ","}
_WORDS = {",": "comma", ".": "point"}
# Columns whose numbers reach a thousand; only there a thousands separator is to be expected.
_LARGE = {"time_s", "n", "ax_mg", "ay_mg", "az_mg"}
_NUMBER = re.compile(r"[+-]?([\d.,]*\d[\d.,]*)([eE][+-]?\d+)?")
_DOUBTFUL = re.compile(r"[1-9]\d{0,2}[.,]\d{3}")
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
            if mark := _mark(cell, large=name in _LARGE).decimal:
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
    doubtful = {name: _doubtful(table.columns[name]) for name in _numeric(table) if name in _LARGE}
    both = mark is None and len(set().union(*doubtful.values())) > 1
    plain, faults = dict[str, list[object]](), list[str]()
    for name in _numeric(table):
        cells, own = table.columns[name], doubtful.get(name, set())
        if own - {mark} and (both or not _groups_thousands(name, cells, mark)):
            rows = [row for row, cell in enumerate(cells) if _mark(cell, large=True).doubtful not in (None, mark)]
            faults += [f"{table.place(row, name)}: {_either(str(cells[row]).strip(), mark)}" for row in rows]
        decimal = mark or (OTHER[min(own)] if own else ".")
        plain[name] = [_with_point(cell, decimal) for cell in cells]
    if faults:
        raise InputError(faults[:_MOST_FAULTS])
    return replace(table, columns={**table.columns, **plain})


def _numeric(table: Table) -> list[str]:
    return [name for name in table.columns if name in KNOWN and name not in LABELS]


def _mark(cell: object, *, large: bool) -> _Mark:
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
    return _Mark(doubtful=mark) if large and not match[2] and _DOUBTFUL.fullmatch(digits) else _Mark(mark)


def _doubtful(cells: Sequence[object]) -> set[str]:
    """The marks of a column's cells that may be either."""
    return {mark for cell in cells if (mark := _mark(cell, large=True).doubtful)}


def _groups_thousands(name: str, cells: Sequence[object], mark: str | None) -> bool:
    """Whether the mark of a column's doubtful cells is beyond doubt a thousands separator."""
    if mark and (name == "n" or any(_mark(cell, large=True).grouped for cell in cells)):
        return True
    unmarked = [cell.strip().lstrip("+-") for cell in cells if isinstance(cell, str)]
    sizes = [int(digits) for digits in unmarked if digits.isascii() and digits.isdigit() and len(digits) < 10]
    return bool(sizes) and max(sizes) < 1000


def _either(cell: str, mark: str | None) -> str:
    own = next(own for own in OTHER if own in cell)
    plain = cell.replace(own, "")
    beside = f" beside decimal {_WORDS[mark]}s" if mark else ""
    decimal = f"{cell.replace(own, mark)}" if mark else f"{cell}0"
    return f"{shown(cell)}{beside} may be {plain} or {cell.replace(own, '.')}; write {plain} or {decimal}"


def _with_point(cell: object, decimal: str) -> object:
    if not isinstance(cell, str) or not _NUMBER.fullmatch(cell.strip()) or _mark(cell, large=True) == _Mark():
        return cell
    return cell.strip().replace(OTHER[decimal], "").replace(",", ".")
