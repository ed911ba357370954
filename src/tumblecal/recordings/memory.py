"""A bound of the memory that a recording may need, checked before it is allocated."""

from pathlib import Path

from tumblecal.ground.errors import InputError


_TIMES, _BASE = 4, 500_000_000


def require_size(path: Path, what: str, needed: int, held: int, remedy: str) -> None:
    """Check that a part of a file needs at most 500 MB and four times the size of its values in the file.

    **Arguments:**

    - `what`: the part, in words. `needed`: bytes of memory. `held`: bytes of the part in the file, decompressed.
    - `remedy`: end of the fault.

    **Raises:** `InputError`.
    """
    if needed > _TIMES * held + _BASE:
        raise InputError(
            f"{path}: {what} need {needed / 1e9:.3g} GB of memory, but the file has {held / 1e6:.3g} MB of them; {remedy}"
        )
