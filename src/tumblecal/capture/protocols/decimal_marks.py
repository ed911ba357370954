"""Which mark stands before decimals and which between thousands, told by numbers that can be written in one way only.

"0,010", "9,81" and "12345,678" have a decimal comma, "1,234,567" and "1,234.5" have commas between thousands; "1,234" alone may
be either. The same holds with the point in the comma's place.
"""

import re
from collections import Counter
from collections.abc import Sequence


_EXPONENT = r"(?:[eE][+-]?\d+)?"
NUMBER = re.compile(
    rf"[+-]?(?:\d+(?:[.,]\d+|\.)?|[.,]\d+){_EXPONENT}"
    r"|[+-]?[1-9]\d{0,2}(?:(?:,\d{3})+(?:\.\d*)?|(?:\.\d{3})+(?:,\d*)?)|nan",
    re.IGNORECASE,
)
# By the mark between the thousands: one group, which may be decimals too; and what is grouped for sure.
_EITHER = {mark: re.compile(rf"[+-]?[1-9]\d{{0,2}}\{mark}\d{{3}}") for mark in ".,"}
_GROUPED = {
    mark: re.compile(rf"[+-]?[1-9]\d{{0,2}}(?:(?:\{mark}\d{{3}}){{2,}}(?:\{other}\d*)?|\{mark}\d{{3}}\{other}\d*)")
    for mark, other in (".,", ",.")
}
_DECIMAL = {mark: re.compile(rf"[+-]?(?:\d*\{mark}\d+|\d+\.){_EXPONENT}") for mark in ".,"}
_OTHER = {".": ",", ",": "."}
_TORN_SHARE = 0.05


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
    seen = Counter(kind for kind in map(_kind, cells) if kind)
    votes = {mark: seen["decimal" + mark] + seen["grouped" + _OTHER[mark]] for mark in ".,"}
    mark = max(votes, key=lambda key: votes[key])
    # A torn cell, such as "5,35" of "5,352", tells nothing against many.
    torn = votes[mark] < seen["hundreds"] and votes[mark] < _TORN_SHARE * seen["either" + mark]
    if votes[mark] and not torn:
        return mark + _OTHER[mark]
    either = [mark for mark in ".," if seen["either" + mark]]
    if len(either) != 1:
        return None if either else ""
    mark = either[0]
    if seen["thousands"]:
        # Who writes 1234 puts no mark between thousands.
        return mark + _OTHER[mark]
    if seen["hundreds"]:
        # Who writes 1.230 drops no zeros at the end, so that 512 beside it is not 512.000.
        ends_with_zero = any(cell.endswith("0") and _EITHER[mark].fullmatch(cell) for cell in cells)
        return _OTHER[mark] + mark if ends_with_zero else None
    return "." if mark == "." else None


def _kind(cell: str) -> str:
    """What a cell tells of the marks."""
    if cell.lstrip("+-").isdecimal():
        size = int(cell.lstrip("+-")[:30])
        return "thousands" if size >= 1000 else "hundreds" if size else ""
    for mark in ".,":
        if _EITHER[mark].fullmatch(cell):
            return "either" + mark
        if _GROUPED[mark].fullmatch(cell):
            return "grouped" + mark
        if _DECIMAL[mark].fullmatch(cell):
            return "decimal" + mark
    return ""
