"""The faults of a file: the first few of each kind, and how many more there are."""

import re

from tumblecal.ground.errors import InputError


MOST_FAULTS = 20
_MOST_ALIKE = 3
# What differs between faults of one kind: quoted cells and numbers.
_OWN = re.compile(r"'[^']*'|\"[^\"]*\"|[-+.\w]*\d[-+.\w]*")


class Faults:
    """Faults as they are found; `source` is the file, as it is named in them."""

    def __init__(self, source: str):
        self.source = source
        self._kinds: dict[tuple[str | None, str], list[str]] = {}

    def __bool__(self) -> bool:
        return bool(self._kinds)

    def add(self, text: str, place: str = "", column: str | None = None) -> None:
        """Add a fault.

        **Arguments:**

        - `text`: what is wrong. `place`: where in the file, as `:line 3`. `column`: that of the cell, if it is one.
        """
        where = self.source + place + (f", column {column}" if column is not None else "")
        self._kinds.setdefault((column, _OWN.sub("", text)), []).append(f"{where}: {text}")

    def stop(self) -> None:
        """End here if anything is wrong.

        **Raises:** `InputError` with the faults.
        """
        lines = list[str]()
        for (column, _), alike in self._kinds.items():
            lines += alike[:_MOST_ALIKE]
            if len(alike) > _MOST_ALIKE:
                where = self.source + (f", column {column}" if column is not None else "")
                lines.append(f"{where}: and {len(alike) - _MOST_ALIKE} more rows like these")
        if len(lines) > MOST_FAULTS:
            lines[MOST_FAULTS:] = [f"{self.source}: and {len(lines) - MOST_FAULTS} more faults"]
        if lines:
            raise InputError(lines)
