"""One decimal mark for a whole file, where spreadsheets wrote it with semicolons or tabs: 0,5 or 0.5, 1.200 or 1,200.

A cell such as 1.200 may be either. It is a decimal in columns that never reach a thousand, and where other cells show the
point to be the decimal mark; it is 1200 where they show the comma to be, or nothing does, and numbers of less than a thousand
stand beside it without a mark. All else is refused.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from tumblecal.data.faults import Faults
from tumblecal.data.table import KNOWN, LABELS, Table
from tumblecal.ground.decimal_marks import OTHER, Marks, number_of, pointed, told_by
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown


if TYPE_CHECKING:
    import polars as pl

_WORDS = {",": "comma", ".": "point"}
# Numbers that may have either mark do only in columns that reach a thousand, and 100 g are no reading.
_READING = r"[1-9]\d?[.,]\d{3}"
_REACH_THOUSAND = {"time_s": r".*", "n": r".*", **dict.fromkeys(("ax_mg", "ay_mg", "az_mg"), rf"[+-]?{_READING}")}


def decimal_mark(table: Table) -> str | None:
    """The decimal mark of a table's numbers; None where no cell tells it.

    **Raises:** `InputError` naming two cells with different marks.
    """
    first: dict[str, tuple[int, str]] = {}
    count = dict.fromkeys(OTHER, 0)
    for name in _numeric(table):
        for row, cell in enumerate(table.columns[name]):
            if mark := _told(cell, name).decimal:
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
    plain, faults = dict[str, list[object]](), Faults(table.source)
    for name in _numeric(table):
        cells, own = table.columns[name], doubtful[name]
        if own - {mark} and (both or not _groups_thousands(name, cells, mark)):
            rows = [row for row, cell in enumerate(cells) if _told(cell, name).either not in (None, mark)]
            for row in rows:
                place = f":{table.row_word} {table.lines[row]}"
                faults.add(either_words(str(cells[row]).strip(), mark), place, name)
        decimal = mark or (OTHER[min(own)] if own else ".")
        plain[name] = [_with_point(cell, name, decimal) for cell in cells]
    faults.stop()
    return replace(table, columns={**table.columns, **plain})


def may_be_thousands(cell: str, separator: str, mark: str | None) -> bool:
    """Whether a cell's only mark is another than a file's decimal one, so that it may separate thousands."""
    either = told_by(cell.strip()).either
    return separator != "," and either is not None and either != mark


def either_words(cell: str, mark: str | None) -> str:
    """That a number such as 1.200 may be two, beside the decimal `mark` of a file or where none is known."""
    own = next(own for own in OTHER if own in cell)
    plain = cell.replace(own, "")
    beside = f" beside decimal {_WORDS[mark]}s" if mark else ""
    decimal = f"{cell.replace(own, mark)}" if mark else f"{cell}0"
    return f"{shown(cell)}{beside} may be {plain} or {cell.replace(own, '.')}; write {plain} or {decimal}"


def written_number(name: str, separator: str, mark: str | None) -> "pl.Expr":
    """The numbers of a column of text in a file with this decimal mark; null for a number that may be another.

    If no reading shows the mark, it is a point, and readings that may be thousands are null.
    """
    import polars as pl

    if separator != "," and mark is not None:
        return number_of(name, mark + OTHER[mark], sure=True)
    number = number_of(name, ".")
    if separator == "," or not name.endswith("_mg"):
        return number
    return pl.when(~pl.col(name).str.contains(rf"^\s*[+-]?{_READING}\s*$")).then(number).alias(name)


def _numeric(table: Table) -> list[str]:
    return [name for name in table.columns if name in KNOWN and name not in LABELS]


def _told(cell: object, name: str) -> Marks:
    """What a cell of a column tells of the marks."""
    text = cell.strip() if isinstance(cell, str) else ""
    told = told_by(text)
    if told.either and not (name in _REACH_THOUSAND and re.fullmatch(_REACH_THOUSAND[name], text)):
        return Marks(told.either)
    return told


def _doubtful(name: str, cells: Sequence[object]) -> set[str]:
    """The marks of a column's cells that may be either."""
    return {mark for cell in cells if (mark := _told(cell, name).either)}


def _groups_thousands(name: str, cells: Sequence[object], mark: str | None) -> bool:
    """Whether the mark of a column's doubtful cells is beyond doubt a thousands separator."""
    if mark and (name == "n" or any(_told(cell, name).grouped for cell in cells)):
        return True
    wholes = [whole for cell in cells if (whole := _told(cell, name).whole) is not None]
    return bool(wholes) and max(wholes) < 1000


def _with_point(cell: object, name: str, decimal: str) -> object:
    told = _told(cell, name)
    return pointed(str(cell).strip(), decimal) if told.decimal or told.either else cell
