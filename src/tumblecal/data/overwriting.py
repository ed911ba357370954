"""Files are given once, and results never overwrite their inputs, or results of a different command."""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tumblecal.ground.errors import InputError


@dataclass(frozen=True)
class Results:
    """Marks of the results of a command: the document that it always writes, and a column of its summary.csv only."""

    command: str
    document: str
    column: str


CALIBRATION = Results("calibrate", "result.json", "judgement")
DIAGNOSIS = Results("diagnose", "diagnosis.json", "verdict")
# Files of both commands.
_SHARED = ("calibration.json", "summary.csv")


def protect_inputs(
    inputs: Iterable[Path | None], *, out: Path | None = None, folders: Sequence[Path] = (), names: Sequence[str] = ()
) -> None:
    """Reject outputs that are inputs, also under a different name or link, or in a folder of results.

    **Arguments:**

    - `inputs`: files that a command reads; None for those not given.
    - `out`: the file to write. `folders`, `names`: folders of results and their files, as glob patterns.

    **Raises:** `InputError` naming both.
    """
    outputs = [*filter(None, [out]), *(path for folder in folders for name in names for path in folder.glob(name))]
    read = {identity(path): path for path in inputs if path is not None and path.exists()}
    for output in outputs:
        if output.exists() and (path := read.get(identity(output))):
            raise InputError(f"{output}: would overwrite the input {path}; give a different --out")


def protect_other_results(written: Results, folders: Iterable[Path]) -> None:
    """Reject folders with results of the other command, which would be mixed with the new ones.

    **Arguments:**

    - `written`: `CALIBRATION` or `DIAGNOSIS`. `folders`: output folders.

    **Raises:** `InputError` naming the folder and its files.
    """
    other = DIAGNOSIS if written is CALIBRATION else CALIBRATION
    for folder in dict.fromkeys(folders):
        found = [other.document] if (folder / other.document).is_file() else []
        found += ["summary.csv"] if other.column in _header(folder / "summary.csv") else []
        if found:
            raise InputError(
                f"{folder}: has {' and '.join(found)} of tumblecal {other.command}, and {written.command} would overwrite its "
                f"{' and '.join(_SHARED)}; give a different --out"
            )


def _header(table: Path) -> list[str]:
    """The names of the columns of a table; none if there is no such file."""
    if not table.is_file():
        return []
    with table.open(encoding="utf-8", errors="replace") as lines:
        return lines.readline().strip().split(",")


def identity(path: Path) -> tuple[int, int]:
    """Identity of a file, equal for all its names."""
    status = path.stat()
    return status.st_dev, status.st_ino


def given_once(files: Sequence[Path]) -> dict[Path, str]:
    """Check that no file is given twice, also under different names; a missing file is ignored here.

    **Returns:** files with the same contents as another, with words.

    **Raises:** `InputError` naming both names of a file.
    """
    existing = [path for path in files if path.is_file()]
    first: dict[tuple[int, int], Path] = {}
    twice = [(path, before) for path in existing if (before := first.setdefault(identity(path), path)) is not path]
    if twice:
        again = [f", the first time as {before}" if before != path else "" for path, before in twice]
        raise InputError(
            [f"{path}: given twice{words}; give each file once" for (path, _), words in zip(twice, again, strict=True)]
        )
    # Only files of equal size are read.
    sizes = [path.stat().st_size for path in existing]
    contents, copies = dict[bytes, Path](), dict[Path, str]()
    for path, size in zip(existing, sizes, strict=True):
        if sizes.count(size) > 1:
            before = contents.setdefault(hashlib.sha256(path.read_bytes()).digest(), path)
            if before is not path:
                words = "so these positions are used twice; remove one of these files"
                copies[path] = f"same contents as {before}, {words}"
    return copies
