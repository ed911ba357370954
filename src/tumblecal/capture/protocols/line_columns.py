"""Quantities of the columns of text lines: given, named by a header line, or learned from the numbers.

The unit comes from the column names, or from a triple whose length is one g in some usual unit.
"""

import math
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tumblecal.data.column_names import FORCE, RATE, parsed, role_of
from tumblecal.data.text_cells import separator_of
from tumblecal.ground.decimal_marks import marks_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import UNITS_PER_G


_LOCK_LINES = 5
_SURELY_RISING = 12
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$")
# Words that boards print instead of a missing number.
_NO_NUMBER = re.compile(r"[+-]?(nan|inf(inity)?|ovf)$", re.IGNORECASE)
_NUMBER_COMMA = re.compile(r"[+-]?\d+,\d+$")
_ROLES = ("ax", "ay", "az", "gx", "gy", "gz", "t", "counter", "time")
# Names without another meaning here.
_SHORT_NAMES: dict[str, str] = dict.fromkeys(
    ("seq", "n", "count", "counter", "index", "packet", "sample", "no"), "counter"
)
_SHORT_NAMES |= dict.fromkeys(("tms", "tus"), "time") | {f"g_{axis}": f"g{axis}" for axis in "xyz"}


@dataclass(frozen=True)
class LineColumns:
    """Layout of the lines.

    **Arguments:**

    - `columns`: quantity of each column: ax, ay, az, gx, gy, gz, t, counter, time, or "-" for an unused one.
    - `unit`: unit of the specific force, a key of `UNITS_PER_G`.
    - `separator`: between numbers; " " means any white space.
    - `decimal_comma`: 1,5 for 1.5.
    - `checked`: lines end in `*CC`.
    """

    columns: tuple[str, ...]
    unit: str
    separator: str = ","
    decimal_comma: bool = False
    checked: bool = False

    def __post_init__(self) -> None:
        unknown = [c for c in self.columns if c not in _ROLES and c != "-"]
        missing = [c for c in FORCE if c not in self.columns]
        if unknown or missing:
            raise InputError(
                f"text columns {','.join(self.columns)}: "
                + (f"{', '.join(unknown)} unknown" if unknown else f"{', '.join(missing)} missing")
                + f"; give a list of {', '.join(_ROLES)}, or - for an unused column"
            )
        if self.unit not in UNITS_PER_G:
            raise InputError(f"text unit {self.unit!r}: unknown; give one of {', '.join(UNITS_PER_G)}")


def split_line(text: str, separator: str, decimal_comma: bool) -> list[str]:
    """The words of a line, without a leading name."""
    words = text.split() if separator == " " else [w.strip() for w in text.split(separator)]
    if words and not any(pattern.match(words[0]) for pattern in (_NUMBER, _NUMBER_COMMA, _NO_NUMBER)):
        words = words[1:]
    if words and words[-1] == "":
        words = words[:-1]
    return [w.replace(",", ".") for w in words] if decimal_comma else words


def _has_decimal_comma(lines: list[str], separator: str) -> bool:
    """Whether numbers have a decimal comma; boards write no thousands separators."""
    if separator == ",":
        return False
    rows = [split_line(line, separator, False) for line in lines]
    width = max({len(row) for row in rows}, key=lambda n: sum(len(row) == n for row in rows), default=0)
    columns = [list(column) for column in zip(*(row for row in rows if len(row) == width), strict=True)]
    return any(
        marks[0] == "," if marks else any("," in cell for cell in cells)
        for marks, cells in zip(marks_of(columns), columns, strict=True)
    )


def names_of(words: list[str]) -> list[str]:
    """Quantities from a header line; "-" for an unknown name."""
    return [_role_of(word)[0] for word in words]


def _role_of(word: str) -> tuple[str, str]:
    """Quantity and unit of a name; "-" for an unknown one, and for accelerations without gravity."""
    plain = re.sub(r"[\[(].*", "", word).strip().lower()
    if plain in _SHORT_NAMES:
        return _SHORT_NAMES[plain], ""
    role, unit = role_of(word)
    role = {"temperature": "t", "T": "t"}.get(role or "-", role)
    return (role, unit) if role in _ROLES and parsed(word).state not in ("linear", "world", "free") else ("-", "")


def _unit_of_length(length: float) -> str | None:
    """The unit in which this length of the specific force is one g, within a tenth."""
    return next((u for u, per_g in UNITS_PER_G.items() if abs(length / per_g - 1) < 0.1), None)


@np.errstate(over="ignore", invalid="ignore")
def learn(lines: list[str], header: list[str] | None = None, checked: bool = False) -> LineColumns | None:
    """The layout of these lines; None if no specific force is found in them.

    **Arguments:**

    - `lines`: lines of numbers, without their checksum.
    - `header`: words of a header line seen before.
    """
    if not lines:
        return None
    separator = separator_of(lines)
    decimal_comma = _has_decimal_comma(lines, separator)
    rows = [split_line(line, separator, decimal_comma) for line in lines]
    width = max({len(r) for r in rows}, key=lambda n: sum(len(r) == n for r in rows))
    good = [r for r in rows if len(r) == width and all(_NUMBER.match(w) for w in r)]
    if header and len(header) == width + 1:
        # A leading word, which was removed from the rows.
        header = header[1:]
    roles = names_of(header) if header and len(header) == width else ["-"] * width
    named = {*FORCE} <= set(roles)
    if len(good) < (1 if named else _LOCK_LINES) or width < 3:
        return None
    table = np.array(good, float)
    if not named:
        roles = roles_of_values(table, roles)
    if not {*FORCE} <= set(roles):
        return None
    force = table[:, [roles.index(r) for r in FORCE]]
    units = [unit.replace("ms2", "m/s2") for role, unit in map(_role_of, header or ()) if role in FORCE]
    unit = next((unit for unit in units if unit in UNITS_PER_G), None)
    unit = unit or _unit_of_length(float(np.median(np.linalg.norm(force, axis=1))))
    if unit is None:
        return None
    return LineColumns(tuple(roles), unit, separator, decimal_comma, checked)


def roles_of_values(table: NDArray[np.float64], roles: list[str]) -> list[str]:
    """Quantities from the numbers: the first triple of one g is the force, a triple after it the rate."""
    roles = list(roles)
    width = table.shape[1]
    for first in range(width - 2):
        with np.errstate(over="ignore"):  # for numbers that are not readings
            length = float(np.median(np.linalg.norm(table[:, first : first + 3], axis=1)))
        moving = np.diff(table[:, first : first + 3], axis=0)
        # A column that only rises is a time or a counter: by steady steps, or over many lines.
        rising = (moving > 0).all(0) & ((np.ptp(moving, axis=0) == 0) | (len(moving) >= _SURELY_RISING))
        if _unit_of_length(length) and not rising.any():
            roles[first : first + 3] = FORCE
            if first + 6 <= width:
                roles[first + 3 : first + 6] = RATE
            break
    for at in range(width):
        step = np.diff(table[:, at])
        if roles[at] == "-" and (step > 0).all():
            roles[at] = "counter" if (step == 1).all() and "counter" not in roles else "time"
    if roles[-1] == "-" and -40 < float(np.median(table[:, -1])) < 125 and "az" in roles:
        roles[-1] = "t"
    return roles


def looks_numeric(raw: bytes) -> bool:
    """Whether a line has the numbers of a specific force."""
    text = raw.decode("ascii", "replace")
    numbers = re.findall(r"[+-]?\d+(?:\.\d*)?", text)
    letters = re.findall(r"[A-Za-z]{2,}", text)
    return len(numbers) >= 3 and len(letters) <= 1


def header_words(line: bytes) -> list[str] | None:
    """The names in a header line; None for a line without the three specific forces."""
    text = line.decode("ascii", "replace").strip()
    if looks_numeric(line) or not re.search(r"[A-Za-z]", text):
        return None
    separator = separator_of([text])
    words = text.split() if separator == " " else [w.strip() for w in text.split(separator)]
    words = words[1:] if words and words[0].upper() == "LABEL" else words
    return words if {*FORCE} <= set(names_of(words)) else None


def numbers_of(line: bytes, layout: LineColumns) -> list[float] | None:
    """The numbers of a line, NaN for nan, inf and ovf; None if it does not have this layout."""
    try:
        text = line.decode("ascii")
    except UnicodeDecodeError:
        return None
    words = split_line(text, layout.separator, layout.decimal_comma)
    if len(words) != len(layout.columns) or not all(_NUMBER.match(w) or _NO_NUMBER.match(w) for w in words):
        return None
    return [math.nan if _NO_NUMBER.match(w) else float(w) for w in words]
