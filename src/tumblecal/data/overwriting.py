"""Results never take the place of what they were made of, nor of another command's."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tumblecal.data.same_files import identity
from tumblecal.ground.errors import InputError


@dataclass(frozen=True)
class Results:
    """What tells the results of a command: the document that it always writes, and a column that only its summary.csv has."""

    command: str
    document: str
    column: str


CALIBRATION = Results("calibrate", "result.json", "judgement")
DIAGNOSIS = Results("diagnose", "diagnosis.json", "verdict")
# Files that each of them writes.
_SHARED = ("calibration.json", "summary.csv")


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
    read = {identity(path): path for path in inputs if path is not None and path.exists()}
    for output in outputs:
        if output.exists() and (path := read.get(identity(output))):
            raise InputError(f"{output}: would overwrite {path}, which is an input; give another --out")


def others_kept(own: Results, folders: Iterable[Path]) -> None:
    """Refuse folders with results of another command, which would be mixed with one's own; one's own are replaced.

    **Arguments:**

    - `own`: the command's, one of `CALIBRATION` and `DIAGNOSIS`. `folders`: where it writes.

    **Raises:** `InputError` naming the folder and what is there.
    """
    other = DIAGNOSIS if own is CALIBRATION else CALIBRATION
    for folder in dict.fromkeys(folders):
        found = [other.document] if (folder / other.document).is_file() else []
        found += ["summary.csv"] if other.column in _header(folder / "summary.csv") else []
        if found:
            raise InputError(
                f"{folder}: holds {' and '.join(found)} of tumblecal {other.command}; {own.command} writes "
                f"{' and '.join(_SHARED)} too, and would mix its results with those; give another --out"
            )


def _header(table: Path) -> list[str]:
    """The names of a table's columns; none where there is no such file."""
    if not table.is_file():
        return []
    with table.open(encoding="utf-8", errors="replace") as lines:
        return lines.readline().strip().split(",")
