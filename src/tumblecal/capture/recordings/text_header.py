"""The line of a text with the names of its columns, and similar lines that are rejected."""

import re
from collections.abc import Sequence
from pathlib import Path

from tumblecal.capture.columns.column_names import quantity_of_name
from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.data.text_cells import numbers_in, row_of, separator_of
from tumblecal.ground.errors import InputError


_COMMAS = (
    "commas between cells are indistinguishable from decimal commas; write decimal points, or semicolons between cells"
)
_BY_NUMBER = "or give the columns by number: --columns time=1,ax=2,ay=3,az=4"


def header_of(
    path: Path, before: Sequence[str], cells: tuple[str, int], options: RecordingOptions
) -> tuple[tuple[str, ...], int | None]:
    """Names of the columns and their line: the last line before the rows with as many names; empty if there is none.

    **Arguments:**

    - `before`: the lines before the rows. `cells`: the separator, and the number of cells of a row.

    **Raises:** `InputError` for a line that names more or fewer columns than the rows have, or one of them twice, unless
        the user gives the columns by number.
    """
    separator, width = cells
    numbered = [(number, line) for number, line in enumerate(before, start=1) if line.strip()][-2:]
    twice: tuple[tuple[str, ...], int] | None = None
    for number, line in reversed(numbered):
        names = _names_in(line, separator, width)
        if len(names) != width or not any(re.search("[A-Za-z]", name) for name in names):
            continue
        names = tuple(name or str(k) for k, name in enumerate(names, start=1))
        if len(set(names)) == width:
            return names, number
        if twice is None and any(map(quantity_of_name, names)):
            twice = names, number
    if twice is not None and not options.columns:
        names, number = twice
        repeated = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{path}:line {number}, column {repeated}: this name occurs twice; remove one, {_BY_NUMBER}")
    if numbered:
        _refuse_other_width(path, numbered[-1], separator, width, options)
    return (), None


def _names_in(line: str, separator: str, width: int) -> list[str]:
    names = row_of(line.lstrip("# "), separator)
    if len(names) != width and separator == " ":
        names = row_of(line.lstrip("# "), separator_of([line]))
    return names


def _refuse_other_width(
    path: Path, last: tuple[int, str], separator: str, width: int, options: RecordingOptions
) -> None:
    """Raise for a line that names columns, but not as many as the rows have, unless the user gives columns by number."""
    line, text = last
    names = row_of(text.lstrip("# "), separator)
    if len(names) < 3 or len(names) == width or numbers_in(names) or not any(map(quantity_of_name, names)):
        return
    if separator == "," and width == 2 * len(names):
        remedy = _COMMAS
    elif options.columns:
        return
    else:
        remedy = f"correct the header line, {_BY_NUMBER}"
    raise InputError(f"{path}:line {line}: names {len(names)} columns, but the rows have {width} cells; {remedy}")


def refuse_fractions(path: Path, row: list[str], line: int, rows: list[list[str]], separator: str) -> None:
    """Raise for rows without names in which every second cell has digits with leading zeros, as in 0,0100,9,8067.

    **Raises:** `InputError` with the first row.
    """
    fractions = [[cells[k] for cells in rows] for k in range(1, len(row), 2)]
    if (
        separator == ","
        and len(row) % 2 == 0
        and all(all(map(str.isdecimal, cells)) and any(re.match(r"0\d", cell) for cell in cells) for cells in fractions)
    ):
        raise InputError(f"{path}:line {line}: {','.join(row)[:60]!r}: {_COMMAS}")
