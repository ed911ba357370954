"""The faults of a file: one line for each kind, with the other places of the same kind."""

import re
from typing import TYPE_CHECKING

import numpy as np

from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.data.table import Table

_MOST_FAULTS = 20
# Further places of a kind that are listed; the others are counted.
_MOST_PLACES = 2
# Parts that differ between faults of one kind: quoted cells and numbers.
_SPECIFIC = re.compile(r"'[^']*'|\"[^\"]*\"|[-+.\w]*\d[-+.\w]*")


class Faults:
    """Collected faults; `source` is the name of the file in them."""

    def __init__(self, source: str):
        self.source = source
        self._kinds: dict[tuple[str | None, str], dict[str, str]] = {}

    def __bool__(self) -> bool:
        return bool(self._kinds)

    def add(self, text: str, place: str = "", column: str | None = None) -> None:
        """Add a fault.

        **Arguments:**

        - `text`: fault and remedy. `place`: in the file, such as `:line 3`. `column`: of the cell, if any.
        """
        kind = _SPECIFIC.sub("", text) if place else text
        self._kinds.setdefault((column, kind), {}).setdefault(place, text)

    def add_rows(self, table: "Table", column: str, rows: np.ndarray, text: str) -> None:
        """Add a fault of the cells of a column in the rows of a mask."""
        for row in np.flatnonzero(rows).tolist():
            self.add(text, table.line_of(row), column)

    def stop(self) -> None:
        """Raise the collected faults: `FILE:line 3, column az_g: fault; remedy (also in lines 5, 8 and 14 more)`.

        **Raises:** `InputError` if there are any.
        """
        lines = list[str]()
        for (column, _), faults in self._kinds.items():
            (place, text), *others = faults.items()
            where = self.source + place + (f", column {column}" if column is not None else "")
            lines.append(f"{where}: {text}{_also([other for other, _ in others])}")
        if len(lines) > _MOST_FAULTS:
            lines[_MOST_FAULTS:] = [f"{self.source}: and {len(lines) - _MOST_FAULTS} more faults"]
        if lines:
            raise InputError(lines)


def _also(places: list[str]) -> str:
    """Further places, such as ` (also in lines 5, 8 and 14 more)`; "" if there are none."""
    if not places:
        return ""
    word = places[0].lstrip(":").split()[0]
    more = [f"{len(places) - _MOST_PLACES} more"] if len(places) > _MOST_PLACES else []
    *first, last = [*(place.split()[-1] for place in places[:_MOST_PLACES]), *more]
    listed = f"{', '.join(first)} and {last}" if first else last
    return f" (also in {word}{'s' if len(places) > 1 else ''} {listed})"
