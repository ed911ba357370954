"""The last line of a text: without an end it may be cut off, and its last cell another number than was written."""

import os
import re
from collections.abc import Sequence
from pathlib import Path

from tumblecal.ground.text_file import opened, plain_ends


_TAIL = 1 << 16
_NUMBER = re.compile(r"[+-]?(\d*)([.,]?)(\d*)(?:[eE][+-]?(\d*))?")


def lines_at_end(path: Path) -> tuple[list[str], bool]:
    """The last lines of a text, 64 kB of them or all, and whether the last of them has its end."""
    with opened(path) as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - _TAIL))
        lines = plain_ends(file.read()).decode("utf-8", "replace").split("\n")
    whole = lines[1:] if size > _TAIL else lines
    return (whole[:-1], True) if whole and not whole[-1] else (whole, False)


def may_be_cut(cell: str, others: Sequence[str], *, digits: str = "fewest") -> bool:
    """Whether the last cell of a line without an end may be the beginning of what was written, by others of its column.

    A number is whole that has as many decimals (exponent digits, or digits where no number has decimals) as the others have;
    a label, or an empty cell, that is one of theirs. What is cut beyond the `fewest` decimals of them is less than the column
    resolves.

    **Arguments:**

    - `digits`: "fewest", or "most" of the others' decimals are wanted.
    """
    if cell in others:
        return False
    others = [other for other in others if other]
    if not others:
        return False
    own, rest = _NUMBER.fullmatch(cell), [_NUMBER.fullmatch(other) for other in others]
    numbers = [match for match in rest if match]
    if own is None or not numbers:
        return True
    exponents = [match[4] for match in numbers if match[4] is not None]
    if exponents and own[4] is not None:
        return len(own[4]) < max(map(len, exponents))
    if exponents and len(exponents) == len(numbers):
        return True
    decimals = [len(match[3]) for match in numbers]
    if not any(decimals) and not own[2]:
        return len(own[1]) < max(len(match[1]) for match in numbers)
    wanted = max(decimals) if exponents or digits == "most" else max(1, min(decimals))
    return len(own[3]) < wanted
