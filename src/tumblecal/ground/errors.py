"""What is told to a user whose input cannot be used."""

# Loaded by every command before it can be interrupted in order: whatever it needs for annotations alone is not loaded.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

# A fault quotes what a user wrote; more of it helps nobody.
_LONGEST, _TAIL = 800, 200


def one_line(text: str) -> str:
    """`text` with line breaks and other control characters written as escapes."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


class InputError(ValueError):
    """Input that cannot be used: each fault is one line saying what, where and what to do.

    The command line prints the faults and ends with code 2; no traceback, nothing written.

    **Arguments:**

    - `faults`: one line, or several when a file has several faults. Control characters in it, such as those of a
      file's name, are escaped, and what is very long is shortened.
    """

    faults: tuple[str, ...]

    def __init__(self, faults: "str | Sequence[str]"):
        self.faults = tuple(map(_short, (faults,) if isinstance(faults, str) else faults))
        super().__init__("\n".join(self.faults))

    def __reduce__(self) -> tuple:
        return InputError, (self.faults,)


def _short(fault: str) -> str:
    fault = one_line(fault)
    return fault if len(fault) <= _LONGEST else f"{fault[: _LONGEST - _TAIL]} ... {fault[-_TAIL:]}"
