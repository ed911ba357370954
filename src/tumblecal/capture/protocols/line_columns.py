"""Quantities of the columns of text lines: given, or named by a header line; without names they are proposed, never used.

The unit is given, comes from the column names, or is the usual one in which the specific force has a length of one g.
"""

import re
from dataclasses import dataclass

import numpy as np

from tumblecal.capture.decoding.samples import Floats
from tumblecal.data.column_names import FORCE, RATE, parsed, role_of
from tumblecal.data.text_cells import separator_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import UNITS_PER_G


# Lines of a layout from which its columns are proposed.
_FEWEST_LINES = 5
# A number, or a word that boards print instead of a missing one.
_CELL = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)$|[+-]?(?:nan|inf(?:inity)?|ovf)$", re.IGNORECASE)
ROLES = (*FORCE, *RATE, "t", "counter", "time")
# Names with another meaning, or none, in other tables.
_NAMES = {"tms": "time", "tus": "time", "temperature": "t"} | {f"g_{axis}": f"g{axis}" for axis in "xyz"}
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

    def row(self, line: bytes) -> dict[str, float] | None:
        """The numbers of a line by quantity, force in g, NaN for nan, inf and ovf; None for a line of a different layout."""
        numbers = _numbers(line.decode("ascii", "replace"), self.separator, self.decimal_comma)
        if numbers is None or len(numbers) != len(self.columns):
            return None
        row = dict(zip(self.columns, numbers, strict=True))
        return row | {role: row[role] / UNITS_PER_G[self.unit] for role in FORCE}


def check_given(columns: tuple[str, ...], unit: str) -> None:
    """Check the options of the user; empty for none.

    **Raises:** `InputError` for an unknown quantity or unit, or an incomplete specific force.
    """
    if columns and not {*FORCE} <= {*columns} <= {*ROLES, "-"}:
        raise InputError(
            f"text columns {','.join(columns)}: give ax, ay and az, and {', '.join(ROLES[3:])}, or - for an unused column"
        )
    if unit and unit not in UNITS_PER_G:
        raise InputError(f"text unit {unit!r}: unknown; give one of {', '.join(UNITS_PER_G)}")


def _numbers(text: str, separator: str, decimal_comma: bool) -> list[float] | None:
    """The numbers of a line, without a leading name; None for a line with other words."""
    words = text.split(None if separator == " " else separator)
    words = [word.strip().replace(",", ".") if decimal_comma else word.strip() for word in words]
    if words and not _CELL.match(words[0]):
        words = words[1:]
    if words and words[-1] == "":
        words = words[:-1]
    cells = [_CELL.match(word) for word in words]
    return [float(cell[1] or "nan") for cell in cells if cell] if all(cells) else None


def _role_of(word: str) -> tuple[str, str]:
    """Quantity and unit of a name; "-" for an unknown one, and for accelerations without gravity."""
    role, unit = role_of(word)
    role = _NAMES.get(re.sub(r"[\[(].*", "", word).strip().lower(), _NAMES.get(role, role))
    return (role, unit) if role in ROLES and parsed(word).state not in ("linear", "world", "free") else ("-", "")


def names_of(words: list[str]) -> list[str]:
    """Quantities from a header line; "-" for an unknown name."""
    return [_role_of(word)[0] for word in words]


def _unit_by_length(force: Floats) -> str:
    """The unit in which the usual length of the specific force (n, 3) is one g, within a tenth; "" for none."""
    length = float(np.median(np.linalg.norm(force, axis=1)))
    return next((unit for unit, per_g in UNITS_PER_G.items() if abs(length / per_g - 1) < 0.1), "")


@np.errstate(over="ignore", invalid="ignore")
def learn(
    lines: list[str], header: list[str], given: tuple[tuple[str, ...], str], checked: bool
) -> tuple[LineColumns | None, str]:
    """The layout of these lines, or a question to the user.

    **Arguments:**

    - `lines`: lines of numbers, without their checksum.
    - `header`: words of a header line before them; empty for none. `given`: columns and unit of the user; empty for none.

    Both are empty if the lines have no specific force, or are too few.
    """
    separator = separator_of(lines)
    # Between other separators a comma is a decimal mark: boards write no thousands separators.
    decimal_comma = separator != "," and any("," in line for line in lines)
    rows = [row for line in lines if (row := _numbers(line, separator, decimal_comma))]
    widths = [len(row) for row in rows]
    width = max(set(widths), key=widths.count, default=0)
    # A leading word was removed from the rows.
    header = header[1:] if len(header) == width + 1 else header
    columns, unit = given[0] or tuple(names_of(header)), given[1]
    table = np.array([row for row in rows if len(row) == width and np.isfinite(row).all()])
    if not len(table) or width < 3:
        return None, ""
    if len(columns) == width and {*FORCE} <= {*columns}:
        units = [unit, *(of.replace("ms2", "m/s2") for role, of in map(_role_of, header) if role in FORCE)]
        by_length = _unit_by_length(table[:, [columns.index(role) for role in FORCE]])
        unit = next((unit for unit in units if unit in UNITS_PER_G), by_length)
        words = f"the unit of the specific force is not known: give --unit ({', '.join(UNITS_PER_G)})"
        return (LineColumns(columns, unit, separator, decimal_comma, checked), "") if unit else (None, words)
    steps = np.diff(table, axis=0)
    rising = np.logical_and.reduce(steps > 0)
    for first in range(width - 2) if len(table) >= _FEWEST_LINES else ():
        # A column that only rises is a time or a counter.
        by_length = unit or _unit_by_length(table[:, first : first + 3])
        if by_length and not rising[first : first + 3].any():
            names = np.where((steps == 1).all(axis=0), "counter", np.where(rising, "time", "-")).tolist()
            triads = FORCE + RATE if first + 6 <= width else FORCE
            names[first : first + len(triads)] = triads
            return None, (
                f"lines of {width} numbers without names: give --columns {','.join(names)} --unit '{by_length}' (proposed "
                "from the values, check them), or port.columns and port.unit in the plan of a capture"
            )
    return None, ""


def looks_numeric(line: bytes) -> bool:
    """Whether a line has the numbers of a specific force."""
    text = line.decode("ascii", "replace")
    return len(re.findall(r"[+-]?\d+(?:\.\d*)?", text)) >= 3 and len(re.findall(r"[A-Za-z]{2,}", text)) <= 1


def header_words(line: bytes) -> list[str]:
    """The names in a header line; empty for a line without the three specific forces."""
    text = line.decode("ascii", "replace").strip()
    if not re.search(r"[A-Za-z]", text) or 3 * text.count("\ufffd") > len(text) or looks_numeric(line):
        return []
    separator = separator_of([text])
    words = text.split() if separator == " " else [word.strip() for word in text.split(separator)]
    words = words[1:] if words[0].upper() == "LABEL" else words
    return words if {*FORCE} <= set(names_of(words)) else []
