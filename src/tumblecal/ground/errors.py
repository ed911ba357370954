"""Faults of input, as a user reads them."""

# Every command imports this module before its signal handlers are ready, so imports for annotations only are omitted.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

# Largest length of a fault, and of its end if it is shortened.
_LONGEST, _TAIL = 800, 200


def one_line(text: str) -> str:
    """`text` with line breaks and other control characters written as escapes."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


class InputError(ValueError):
    """Input that cannot be used: each fault is one line with fault, place and remedy.

    The command line prints the faults and ends with code 2, without a traceback and without output files.

    **Arguments:**

    - `faults`: one line, or several for several faults of a file. Control characters, for example in a file name, are
      escaped, and very long lines are shortened.

    Examples:
        >>> import tumblecal
        >>> try:
        ...     tumblecal.read_positions("missing.csv")
        ... except tumblecal.InputError as error:
        ...     print(error.faults)
        ('missing.csv: no such file',)
    """

    faults: tuple[str, ...]

    def __init__(self, faults: "str | Sequence[str]"):
        self.faults = tuple(map(_short, (faults,) if isinstance(faults, str) else faults))
        super().__init__("\n".join(self.faults))

    def __reduce__(self) -> tuple[object, ...]:
        return InputError, (self.faults,)


class SupplementWarning(UserWarning):
    """A figure or page is missing or incomplete; the results are complete."""


def _short(fault: str) -> str:
    fault = one_line(fault)
    return fault if len(fault) <= _LONGEST else f"{fault[: _LONGEST - _TAIL]} ... {fault[-_TAIL:]}"
