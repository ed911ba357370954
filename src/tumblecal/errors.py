"""What is told to a user whose input cannot be used."""

from collections.abc import Sequence


class InputError(ValueError):
    """Input that cannot be used: each fault is one line saying what, where and what to do.

    The command line prints the faults and ends with code 2; no traceback, nothing written.

    **Arguments:**

    - `faults`: one line, or several when a file has several faults.
    """

    faults: tuple[str, ...]

    def __init__(self, faults: str | Sequence[str]):
        self.faults = (faults,) if isinstance(faults, str) else tuple(faults)
        super().__init__("\n".join(self.faults))
