"""Quantities of the columns of text lines: given, named by a header line, or learned from the numbers.

The unit comes from the column names, or from a triple whose length is one g in some usual unit.
"""

import math
import re
from dataclasses import dataclass

import numpy as np

from tumblecal.capture.decoding.samples import Floats
from tumblecal.data.column_names import FORCE, RATE, parsed, role_of
from tumblecal.data.text_cells import separator_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import UNITS_PER_G


_LOCK_LINES = 5
_SURELY_RISING = 12
# A number, or a word that boards print instead of a missing one.
_CELL = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)$|[+-]?(?:nan|inf(?:inity)?|ovf)$", re.IGNORECASE)
_ROLES = (*FORCE, *RATE, "t", "counter", "time")
# Names with another meaning, or none, in other tables.
_NAMES = {"tms": "time", "tus": "time"} | {f"g_{axis}": f"g{axis}" for axis in "xyz"}
_NAMES |= dict.fromkeys(("seq", "n", "count", "counter", "index", "packet", "sample", "no"), "counter")


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

    def row(self, line: bytes) -> list[float] | None:
        """The numbers of a line in the order of `_ROLES`, force in g; None if the line does not have this layout.

        NaN for nan, inf and ovf, for quantities that are not in the lines, and for rates of fewer than three axes.
        """
        cells = [
            _CELL.match(word) for word in _words(line.decode("ascii", "replace"), self.separator, self.decimal_comma)
        ]
        if len(cells) != len(self.columns) or not all(cells) or not line.isascii():
            return None
        numbers = {
            role: float(cell[1]) if cell[1] else math.nan
            for role, cell in zip(self.columns, cells, strict=True)
            if cell
        }
        force = [numbers[role] / UNITS_PER_G[self.unit] for role in FORCE]
        known = _ROLES[3:] if set(RATE) <= set(numbers) else _ROLES[6:]
        return force + [numbers[role] if role in known and role in numbers else math.nan for role in _ROLES[3:]]


def _words(text: str, separator: str, decimal_comma: bool = False) -> list[str]:
    """The words of a line, without a leading name."""
    words = text.split() if separator == " " else [word.strip() for word in text.split(separator)]
    if words and not _CELL.match(words[0].replace(",", ".")):
        words = words[1:]
    if words and words[-1] == "":
        words = words[:-1]
    return [word.replace(",", ".") for word in words] if decimal_comma else words


def _role_of(word: str) -> tuple[str, str]:
    """Quantity and unit of a name; "-" for an unknown one, and for accelerations without gravity."""
    role, unit = role_of(word)
    role = _NAMES.get(re.sub(r"[\[(].*", "", word).strip().lower(), "t" if role == "temperature" else role)
    return (role, unit) if role in _ROLES and parsed(word).state not in ("linear", "world", "free") else ("-", "")


def names_of(words: list[str]) -> list[str]:
    """Quantities from a header line; "-" for an unknown name."""
    return [_role_of(word)[0] for word in words]


def _unit_of_length(length: float) -> str | None:
    """The unit in which this length of the specific force is one g, within a tenth."""
    return next((unit for unit, per_g in UNITS_PER_G.items() if abs(length / per_g - 1) < 0.1), None)


@np.errstate(over="ignore", invalid="ignore")
def learn(lines: list[str], header: list[str] | None = None, checked: bool = False) -> LineColumns | None:
    """The layout of these lines; None if no specific force is found in them.

    **Arguments:**

    - `lines`: lines of numbers, without their checksum.
    - `header`: words of a header line seen before.
    """
    separator = separator_of(lines)
    # Between other separators a comma is a decimal mark: boards write no thousands separators.
    decimal_comma = separator != "," and any("," in word for line in lines for word in _words(line, separator))
    rows = [_words(line, separator, decimal_comma) for line in lines]
    widths = [len(row) for row in rows]
    width = max(set(widths), key=widths.count, default=0)
    numbers = [[_CELL.match(word) for word in row] for row in rows if len(row) == width]
    good = [[cell[1] for cell in row if cell] for row in numbers if all(cell and cell[1] for cell in row)]
    # A leading word was removed from the rows.
    header = header[1:] if header and len(header) == width + 1 else header
    roles = names_of(header) if header and len(header) == width else ["-"] * width
    named = {*FORCE} <= set(roles)
    if len(good) < (1 if named else _LOCK_LINES) or width < 3:
        return None
    table = np.array(good, float)
    roles = roles if named else roles_of_values(table, roles)
    if not {*FORCE} <= set(roles):
        return None
    units = [unit.replace("ms2", "m/s2") for role, unit in map(_role_of, header or ()) if role in FORCE]
    force = table[:, [roles.index(role) for role in FORCE]]
    by_length = _unit_of_length(float(np.median(np.linalg.norm(force, axis=1))))
    unit = next((unit for unit in units if unit in UNITS_PER_G), by_length)
    return None if unit is None else LineColumns(tuple(roles), unit, separator, decimal_comma, checked)


def roles_of_values(table: Floats, roles: list[str]) -> list[str]:
    """Quantities from the numbers: the first triple of one g is the force, a triple after it the rate."""
    roles, width, steps = list(roles), table.shape[1], np.diff(table, axis=0)
    # A column that only rises is a time or a counter: by steady steps, or over many lines.
    rising = (steps > 0).all(axis=0)
    surely = rising & ((np.ptp(steps, axis=0) == 0) | (len(steps) >= _SURELY_RISING))
    for first in range(width - 2):
        triple = slice(first, first + 3)
        if _unit_of_length(float(np.median(np.linalg.norm(table[:, triple], axis=1)))) and not surely[triple].any():
            roles[triple] = FORCE
            if first + 6 <= width:
                roles[first + 3 : first + 6] = RATE
            break
    for at in np.flatnonzero(rising).tolist():
        if roles[at] == "-":
            roles[at] = "counter" if (steps[:, at] == 1).all() and "counter" not in roles else "time"
    if roles[-1] == "-" and "az" in roles and -40 < float(np.median(table[:, -1])) < 125:
        roles[-1] = "t"
    return roles


def looks_numeric(line: bytes) -> bool:
    """Whether a line has the numbers of a specific force."""
    text = line.decode("ascii", "replace")
    return len(re.findall(r"[+-]?\d+(?:\.\d*)?", text)) >= 3 and len(re.findall(r"[A-Za-z]{2,}", text)) <= 1


def header_words(line: bytes) -> list[str] | None:
    """The names in a header line; None for a line without the three specific forces."""
    text = line.decode("ascii", "replace").strip()
    if not re.search(r"[A-Za-z]", text) or 3 * text.count("\ufffd") > len(text) or looks_numeric(line):
        return None
    separator = separator_of([text])
    words = text.split() if separator == " " else [word.strip() for word in text.split(separator)]
    words = words[1:] if words[0].upper() == "LABEL" else words
    return words if {*FORCE} <= set(names_of(words)) else None
