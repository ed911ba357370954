"""Which mark stands before decimals and which between thousands, told by numbers that can be written in one way only.

"0,010", "9,81" and "12345,678" have a decimal comma, "1,234,567" and "1,234.5" have commas between thousands; "1,234" alone may
be either. The same holds with the point in the comma's place. Recordings are read by the marks that most of their cells show
(`marks_of`); tables of positions have one decimal mark, and a number that may be another is refused (`with_points`).
"""

import re
from collections import Counter
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
# Digits and marks, and what follows them.
_MARKED = re.compile(rf"[+-]?([\d.,]*\d[\d.,]*)({_EXPONENT})")
_EITHER = re.compile(r"[1-9]\d{0,2}[.,]\d{3}")
_TORN_SHARE = 0.05


class Marks(NamedTuple):
    """What a cell tells of the marks.

    - `decimal`: the mark that stands before its decimals, or would; None where it does not tell.
    - `grouped`: whether the other one stands between its thousands.
    - `either`: its only mark, which may be of decimals or of thousands.
    - `whole`: a number without a mark.
    """

    decimal: str | None = None
    grouped: bool = False
    either: str | None = None
    whole: int | None = None


def told_by(cell: str) -> Marks:
    """What one cell tells; nothing where it is no number that anybody writes."""
    match = _MARKED.fullmatch(cell)
    if match is None:
        return Marks()
    digits, exponent = match[1], match[2]
    marks = sorted((mark for mark in OTHER if mark in digits), key=digits.rindex)
    if not marks:
        return Marks() if exponent else Marks(whole=int(digits[:30]))
    # Of two marks the last is the decimal one; one that stands there twice is of thousands.
    decimal = marks[1] if len(marks) == 2 else OTHER[marks[0]]
    if len(marks) == 2 or digits.count(marks[0]) > 1:
        return Marks(decimal, grouped=True) if _GROUPED[decimal].fullmatch(digits) else Marks()
    return Marks(either=marks[0]) if not exponent and _EITHER.fullmatch(digits) else Marks(marks[0])


def grouped_by_three(decimal: str) -> str:
    """How numbers that have thousands apart for sure are written where this is the decimal mark: a regular expression."""
    group = rf"\{OTHER[decimal]}\d{{3}}"
    return rf"[1-9]\d{{0,2}}(?:(?:{group}){{2,}}(?:\{decimal}\d*)?|{group}\{decimal}\d*)"


def pointed(number: str, decimal: str) -> str:
    """A number with this decimal mark, with a decimal point and nothing between its thousands."""
    return number.replace(OTHER[decimal], "").replace(",", ".")


def without_decimal_comma(option: str) -> str:
    """An option with points for commas between digits: nobody separates numbers so there."""
    return re.sub(r"(?<=\d),(?=\d)", ".", option)


_GROUPED = {decimal: re.compile(grouped_by_three(decimal)) for decimal in OTHER}


def marks_of(columns: Sequence[Sequence[str]]) -> tuple[str | None, ...]:
    """The marks of each column of cells: one for the whole table where its numbers do not contradict each other.

    **Returns:** "." or "," where nothing has told the mark of thousands; ".," and ",." with that behind; None for a column
    with numbers such as "1,234" where nothing in the table tells which they are.
    """
    own = [_own_marks(cells) for cells in columns]
    sure = {marks for marks in own if marks and len(marks) == 2}
    if len(sure) == 1:
        return (*sure,) * len(own)
    # Beside columns with a decimal comma a point that may be either is not taken for a decimal.
    unmarked = {"": ".", ".": None} if sure else {"": "."}
    return tuple(None if marks is None else unmarked.get(marks, marks) for marks in own)


def _own_marks(cells: Sequence[str]) -> str | None:
    """The marks by one column alone: "" where it has none, "." for points that may be either but are the usual decimals."""
    told = [told_by(cell) for cell in cells]
    votes, may_be = Counter(own.decimal for own in told), Counter(own.either for own in told)
    hundreds = sum(0 < (own.whole or 0) < 1000 for own in told)
    mark = max(".,", key=lambda key: votes[key])
    # A torn cell, such as "5,35" of "5,352", tells nothing against many.
    torn = votes[mark] < hundreds and votes[mark] < _TORN_SHARE * may_be[mark]
    if votes[mark] and not torn:
        return mark + OTHER[mark]
    either = [mark for mark in ".," if may_be[mark]]
    if len(either) != 1:
        return None if either else ""
    mark = either[0]
    if any((own.whole or 0) >= 1000 for own in told):
        # Who writes 1234 puts no mark between thousands.
        return mark + OTHER[mark]
    if hundreds:
        # Who writes 1.230 drops no zeros at the end, so that 512 beside it is not 512.000.
        ends_with_zero = any(own.either == mark and cell.endswith("0") for own, cell in zip(told, cells, strict=True))
        return OTHER[mark] + mark if ends_with_zero else None
    return "." if mark == "." else None


def number_of(name: str, marks: str, *, sure: bool = False, either: str = "") -> "pl.Expr":
    """The numbers of a column of text; null for what is written otherwise.

    **Arguments:**

    - `marks`: the decimal mark, and that of thousands if there is one, as `marks_of` finds them.
    - `sure`: numbers that may be either, such as "1,234" with decimal points, are null. `either`: so are cells of this pattern.
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
    """Columns of cells that have one decimal mark, and how their faults are named.

    **Arguments:**

    - `cells`: by column. `thousands`: of columns that reach a thousand, the pattern of cells that may do so.
    - `source`: the file. `place`: of a cell in it, by its row and column.
    """

    cells: Mapping[str, Sequence[object]]
    thousands: Mapping[str, str]
    source: str
    place: Callable[[int, str], str]

    def told(self, cell: object, name: str) -> Marks:
        """What a cell of a column tells of the marks."""
        text = cell.strip() if isinstance(cell, str) else ""
        told = told_by(text)
        if told.either and not re.fullmatch(self.thousands.get(name, r"\b\B"), text):
            return Marks(told.either)
        return told

    def decimal_mark(self) -> str | None:
        """The decimal mark of the numbers; None where no cell tells it.

        **Raises:** `InputError` naming two cells with different marks.
        """
        first, count = dict[str, tuple[int, str]](), dict.fromkeys(OTHER, 0)
        for name, cells in self.cells.items():
            for row, cell in enumerate(cells):
                if mark := self.told(cell, name).decimal:
                    first.setdefault(mark, (row, name))
                    count[mark] += 1
        if len(first) == 2:
            rarer, usual = sorted(first, key=count.__getitem__)
            (row, name), (other_row, other) = first[rarer], first[usual]
            raise InputError(
                f"{self.source}:{self.place(row, name)}: {self.cells[name][row]!r} has a decimal {_WORDS[rarer]}, but "
                f"{self.cells[other][other_row]!r} ({self.place(other_row, other)}) a decimal {_WORDS[usual]}; write one of "
                "them throughout"
            )
        return next(iter(first), None)

    def with_points(self, refuse: Callable[[int, str, str], None]) -> dict[str, Sequence[object]]:
        """The cells with decimal points and without marks between thousands; what is no number stays as it is.

        **Arguments:**

        - `refuse`: gets the row and the column of each cell whose mark may be either, and words for it.

        **Raises:** `InputError` as `decimal_mark` does.
        """
        mark = self.decimal_mark()
        told = {name: [self.told(cell, name) for cell in cells] for name, cells in self.cells.items()}
        doubtful = {name: {own.either for own in marks if own.either} for name, marks in told.items()}
        both = mark is None and len(set().union(*doubtful.values())) > 1
        plain = dict[str, Sequence[object]]()
        for name, cells in self.cells.items():
            if doubtful[name] - {mark} and (both or not _groups_thousands(name, told[name], mark)):
                for row, own in enumerate(told[name]):
                    if own.either not in (None, mark):
                        refuse(row, name, either_words(str(cells[row]).strip(), mark))
            decimal = mark or (OTHER[min(doubtful[name])] if doubtful[name] else ".")
            plain[name] = [
                pointed(str(cell).strip(), decimal) if own.decimal or own.either else cell
                for cell, own in zip(cells, told[name], strict=True)
            ]
        return plain


def _groups_thousands(name: str, told: Sequence[Marks], mark: str | None) -> bool:
    """Whether the mark of a column's doubtful cells is beyond doubt a thousands separator."""
    if mark and (name == "n" or any(own.grouped for own in told)):
        return True
    wholes = [own.whole for own in told if own.whole is not None]
    return bool(wholes) and max(wholes) < 1000


def may_be_thousands(cell: str, mark: str | None) -> bool:
    """Whether a cell's only mark is another than a file's decimal one, so that it may separate thousands."""
    either = told_by(cell.strip()).either
    return either is not None and either != mark


def either_words(cell: str, mark: str | None) -> str:
    """That a number such as 1.200 may be two, with the decimal `mark` of a file or where none is known."""
    own = next(own for own in OTHER if own in cell)
    plain = cell.replace(own, "")
    beside = f" beside decimal {_WORDS[mark]}s" if mark else ""
    decimal = f"{cell.replace(own, mark)}" if mark else f"{cell}0"
    return f"{cell!r}{beside} may be {plain} or {cell.replace(own, '.')}; write {plain} or {decimal}"
