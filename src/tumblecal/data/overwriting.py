"""Results never take the place of what they were made of."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from tumblecal.ground.errors import InputError


def inputs_kept(
    inputs: Iterable[Path | None], *, out: Path | None = None, folders: Sequence[Path] = (), names: Sequence[str] = ()
) -> None:
    """Refuse outputs that are inputs under whatever name: spelled otherwise, linked, inside a folder of results.

    **Arguments:**

    - `inputs`: files that a command reads; None for those not given.
    - `out`: the file to write. `folders`, `names`: folders of results and what is written there, as glob patterns.

    **Raises:** `InputError` naming both.
    """
    outputs = [] if out is None else [out]
    outputs += [path for folder in folders for name in names for path in folder.glob(name)]
    read = {_identity(path): path for path in inputs if path is not None and path.exists()}
    for output in outputs:
        if output.exists() and (path := read.get(_identity(output))):
            raise InputError(f"{output}: would overwrite {path}, which is an input; give another --out")


def _identity(path: Path) -> tuple[int, int]:
    """What two names of one file have in common."""
    status = path.stat()
    return status.st_dev, status.st_ino
