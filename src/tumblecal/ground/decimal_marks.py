"""Decimal marks and thousands separators, determined from unambiguous numbers.

"0,010", "9,81" and "12345,678" have a decimal comma; "1,234,567" and "1,234.5" have thousands separators; "1,234" alone is
ambiguous. The same applies with points and commas exchanged. Tables of positions have one decimal mark, and an ambiguous number
is rejected (`with_points`).
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    import polars as pl

OTHER = {",": ".", ".": ","}
_WORDS = {",": "comma", ".": "point"}
_EXPONENT = r"(?:[eE][+-]?\d+)?"
NUMBER = re.compile(
    rf"[+-]?(?:\d+(?:[.,]\d+|\.)?|[.,]\d+){_EXPONENT}"
    r"|[+-]?[1-9]\d{0,2}(?:(?:,\d{3})+(?:\.\d*)?|(?:\.\d{3})+(?:,\d*)?)|nan",
    re.IGNORECASE,
)
# Digits and marks, and the exponent.
_MARKED = re.compile(rf"[+-]?([\d.,]*\d[\d.,]*)({_EXPONENT})")
_EITHER = re.compile(r"[1-9]\d{0,2}[.,]\d{3}")


class Marks(NamedTuple):
    """Evidence of a cell on the marks.

    - `decimal`: the decimal mark; None if the cell does not determine it.
    - `grouped`: whether it has the other mark as thousands separator.
    - `either`: its only mark, if it may be the decimal mark or a thousands separator.
    - `whole`: a number without a mark.
    """

    decimal: str | None = None
    grouped: bool = False
    either: str | None = None
    whole: int | None = None


def evidence_of(cell: str) -> Marks:
    """The evidence of one cell; none if it is not a number in a usual form."""
    match = _MARKED.fullmatch(cell)
    if match is None:
        return Marks()
    digits, exponent = match[1], match[2]
    marks = sorted((mark for mark in OTHER if mark in digits), key=digits.rindex)
    if not marks:
        return Marks() if exponent else Marks(whole=int(digits[:30]))
    # If there are two marks, the last is the decimal mark; a repeated mark is a thousands separator.
    decimal = marks[1] if len(marks) == 2 else OTHER[marks[0]]
    if len(marks) == 2 or digits.count(marks[0]) > 1:
        return Marks(decimal, grouped=True) if _GROUPED[decimal].fullmatch(digits) else Marks()
    return Marks(either=marks[0]) if not exponent and _EITHER.fullmatch(digits) else Marks(marks[0])


def grouped_by_three(decimal: str) -> str:
    """Regular expression of numbers with unambiguous thousands separators, for this decimal mark."""
    group = rf"\{OTHER[decimal]}\d{{3}}"
    return rf"[1-9]\d{{0,2}}(?:(?:{group}){{2,}}(?:\{decimal}\d*)?|{group}\{decimal}\d*)"


def pointed(number: str, decimal: str) -> str:
    """A number with this decimal mark, converted to a decimal point without thousands separators."""
    return number.replace(OTHER[decimal], "").replace(",", ".")


def without_decimal_comma(option: str) -> str:
    """An option with points in place of commas between digits, which separate no numbers there."""
    return re.sub(r"(?<=\d),(?=\d)", ".", option)


_GROUPED = {decimal: re.compile(grouped_by_three(decimal)) for decimal in OTHER}


def number_of(name: str, marks: str, *, sure: bool = False, either: str = "") -> "pl.Expr":
    """The numbers of a column of text; null for cells in other forms.

    **Arguments:**

    - `marks`: the decimal mark, and the thousands separator if there is one.
    - `sure`: ambiguous numbers, such as "1,234" with decimal points, are null. `either`: cells of this pattern are null.
    """
    import polars as pl

    text = pl.col(name).str.strip_chars().str.strip_chars_start("+")
    plain = text
    if marks[0] == ",":
        plain = pl.when(~text.str.contains(".", literal=True)).then(text.str.replace(",", ".", literal=True))
    if either:
        plain = pl.when(~text.str.contains(rf"^-?(?:{either})$")).then(plain)
    number = plain.cast(pl.Float64, strict=False)
    if marks[1:]:
        decimal, group = (re.escape(mark) for mark in marks)
        thousands = grouped_by_three(marks[0]) if sure else rf"[1-9]\d{{0,2}}({group}\d{{3}})+({decimal}\d*)?"
        grouped = pl.when(text.str.contains(rf"^-?(?:{thousands})$")).then(text)
        whole = grouped.str.replace_all(marks[1], "", literal=True).str.replace(marks[0], ".", literal=True)
        number = pl.coalesce(number, whole.cast(pl.Float64, strict=False))
    return number.alias(name)


@dataclass(frozen=True)
class MarkedColumns:
    """Columns of cells with one decimal mark, and the names of cells in messages.

    **Arguments:**

    - `cells`: by column. `thousands`: for columns with numbers above a thousand, the pattern of such cells.
    - `source`: the file. `place`: of a cell in it, by its row and column.
    """

    cells: Mapping[str, Sequence[object]]
    thousands: Mapping[str, str]
    source: str
    place: Callable[[int, str], str]

    def evidence(self, cell: object, name: str) -> Marks:
        """The evidence of a cell of a column on the marks."""
        text = cell.strip() if isinstance(cell, str) else ""
        marks = evidence_of(text)
        if marks.either and not re.fullmatch(self.thousands.get(name, r"\b\B"), text):
            return Marks(marks.either)
        return marks

    def decimal_mark(self) -> str | None:
        """The decimal mark of the numbers; None if no cell determines it.

        **Raises:** `InputError` naming two cells with different marks.
        """
        first, count = dict[str, tuple[int, str]](), dict.fromkeys(OTHER, 0)
        for name, cells in self.cells.items():
            for row, cell in enumerate(cells):
                if mark := self.evidence(cell, name).decimal:
                    first.setdefault(mark, (row, name))
                    count[mark] += 1
        if len(first) == 2:
            rarer, usual = sorted(first, key=count.__getitem__)
            (row, name), (other_row, other) = first[rarer], first[usual]
            raise InputError(
                f"{self.source}:{self.place(row, name)}: {self.cells[name][row]!r} has a decimal {_WORDS[rarer]}, but "
                f"{self.cells[other][other_row]!r} ({self.place(other_row, other)}) has a decimal {_WORDS[usual]}; write "
                "one of them throughout"
            )
        return next(iter(first), None)

    def with_points(self, refuse: Callable[[int, str, str], None]) -> dict[str, Sequence[object]]:
        """The cells with decimal points and without thousands separators; other cells are unchanged.

        **Arguments:**

        - `refuse`: called with row, column and fault of each cell with an ambiguous mark.

        **Raises:** `InputError` as `decimal_mark` does.
        """
        mark = self.decimal_mark()
        evidence = {name: [self.evidence(cell, name) for cell in cells] for name, cells in self.cells.items()}
        ambiguous = {name: {marks.either for marks in column if marks.either} for name, column in evidence.items()}
        both = mark is None and len(set().union(*ambiguous.values())) > 1
        plain = dict[str, Sequence[object]]()
        for name, cells in self.cells.items():
            if ambiguous[name] - {mark} and (both or not _groups_thousands(name, evidence[name], mark)):
                for row, marks in enumerate(evidence[name]):
                    if marks.either not in (None, mark):
                        refuse(row, name, either_words(str(cells[row]).strip(), mark))
            decimal = mark or (OTHER[min(ambiguous[name])] if ambiguous[name] else ".")
            plain[name] = [
                pointed(str(cell).strip(), decimal) if marks.decimal or marks.either else cell
                for cell, marks in zip(cells, evidence[name], strict=True)
            ]
        return plain


def _groups_thousands(name: str, evidence: Sequence[Marks], mark: str | None) -> bool:
    """Whether the mark of the ambiguous cells of a column is certainly a thousands separator."""
    if mark and (name == "n" or any(marks.grouped for marks in evidence)):
        return True
    wholes = [marks.whole for marks in evidence if marks.whole is not None]
    return bool(wholes) and max(wholes) < 1000


def may_be_thousands(cell: str, mark: str | None) -> bool:
    """Whether the only mark of a cell differs from the decimal mark of the file, so that it may separate thousands."""
    either = evidence_of(cell.strip()).either
    return either is not None and either != mark


def either_words(cell: str, mark: str | None) -> str:
    """The fault of an ambiguous number such as 1.200, with the decimal `mark` of the file, if it is known."""
    ambiguous = next(candidate for candidate in OTHER if candidate in cell)
    plain = cell.replace(ambiguous, "")
    given = f", with decimal {_WORDS[mark]}s in this file," if mark else ""
    decimal = f"{cell.replace(ambiguous, mark)}" if mark else f"{cell}0"
    return f"{cell!r}{given} may be {plain} or {cell.replace(ambiguous, '.')}; write {plain} or {decimal}"
