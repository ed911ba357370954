"""The last line of a text: without a line end it may be truncated, and its last number may be wrong."""

import os
import re
from collections.abc import Sequence
from pathlib import Path

from tumblecal.ground.text_file import opened, plain_ends


_TAIL = 1 << 16
_NUMBER = re.compile(r"[+-]?(\d*)([.,]?)(\d*)(?:[eE][+-]?(\d*))?")


def lines_at_end(path: Path) -> tuple[list[str], bool]:
    """The last lines of a text, up to 64 kB, and whether the last one has a line end."""
    with opened(path) as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - _TAIL))
        lines = plain_ends(file.read()).decode("utf-8", "replace").split("\n")
    whole = lines[1:] if size > _TAIL else lines
    return (whole[:-1], True) if whole and not whole[-1] else (whole, False)


def may_be_cut(cell: str, others: Sequence[str], *, digits: str = "fewest") -> bool:
    """Whether the last cell of a line without a line end may be truncated, compared with other cells of its column.

    A number is complete if it has as many decimals as the others (or exponent digits; or digits if no number has decimals). A
    label, or an empty cell, is complete if it equals one of the others. Digits lost beyond the `fewest` decimals are below the
    resolution of the column.

    **Arguments:**

    - `digits`: whether it needs the "fewest" or the "most" decimals of the others.
    """
    if cell in others:
        return False
    others = [other for other in others if other]
    if not others:
        return False
    last, rest = _NUMBER.fullmatch(cell), [_NUMBER.fullmatch(other) for other in others]
    numbers = [match for match in rest if match]
    if last is None or not numbers:
        return True
    exponents = [match[4] for match in numbers if match[4] is not None]
    if exponents and last[4] is not None:
        return len(last[4]) < max(map(len, exponents))
    if exponents and len(exponents) == len(numbers):
        return True
    decimals = [len(match[3]) for match in numbers]
    if not any(decimals) and not last[2]:
        return len(last[1]) < max(len(match[1]) for match in numbers)
    wanted = max(decimals) if exponents or digits == "most" else max(1, min(decimals))
    return len(last[3]) < wanted
