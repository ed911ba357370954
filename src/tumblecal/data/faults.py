"""The faults of a file: the first few of each kind, and the number of the others."""

import re

from tumblecal.ground.errors import InputError


MOST_FAULTS = 20
_MOST_OF_KIND = 3
# Parts that differ between faults of one kind: quoted cells and numbers.
_SPECIFIC = re.compile(r"'[^']*'|\"[^\"]*\"|[-+.\w]*\d[-+.\w]*")


class Faults:
    """Collected faults; `source` is the name of the file in them."""

    def __init__(self, source: str):
        self.source = source
        self._kinds: dict[tuple[str | None, str], list[str]] = {}

    def __bool__(self) -> bool:
        return bool(self._kinds)

    def add(self, text: str, place: str = "", column: str | None = None) -> None:
        """Add a fault.

        **Arguments:**

        - `text`: fault and remedy. `place`: in the file, such as `:line 3`. `column`: of the cell, if any.
        """
        where = self.source + place + (f", column {column}" if column is not None else "")
        self._kinds.setdefault((column, _SPECIFIC.sub("", text)), []).append(f"{where}: {text}")

    def stop(self) -> None:
        """Raise the collected faults.

        **Raises:** `InputError` if there are any.
        """
        lines = list[str]()
        for (column, _), faults in self._kinds.items():
            lines += faults[:_MOST_OF_KIND]
            if len(faults) > _MOST_OF_KIND:
                where = self.source + (f", column {column}" if column is not None else "")
                lines.append(f"{where}: and {len(faults) - _MOST_OF_KIND} more rows like these")
        if len(lines) > MOST_FAULTS:
            lines[MOST_FAULTS:] = [f"{self.source}: and {len(lines) - MOST_FAULTS} more faults"]
        if lines:
            raise InputError(lines)
