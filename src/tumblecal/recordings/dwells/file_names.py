"""The files of one recording: folders and patterns replaced by them, in natural order (2 before 10); their names."""

import glob
import re
from collections.abc import Sequence
from os.path import commonpath
from pathlib import Path
from typing import Any

from tumblecal.ground.errors import InputError


# In a folder, files with these suffixes are recordings; it may also contain plans, pages and figures.
_TEXTS = (".csv", ".tsv", ".txt", ".dat", ".log", ".asc", ".jsonl", ".xlsx")
_OTHERS = (".parquet", ".mat", ".h5", ".hdf5", ".bag", ".db3", ".mcap", ".ulg", ".bin", ".mtb", ".raw")
# A folder with one of these files is a single recording.
_WHOLE = ("journal.log", "raw.log", "metadata.yaml")
# Files of results, and files in folders of results.
_RESULTS = ("positions.csv", "positions.parquet")
_OF_RESULTS = ("reduction.json", "calibration.json")


def recording_files(given: Sequence[Path], others: Sequence[Path | None] = ()) -> list[Path]:
    """The given files, with folders and patterns replaced by their recordings; a recording that is a folder is not replaced.

    Files are in the given order, unless it is alphabetical, as from a shell's pattern.

    **Arguments:**

    - `others`: files that are not recordings although they are in such a folder.

    **Raises:** `InputError` for a pattern, or several folders, without a recording.
    """
    left_out = {path.resolve() for path in others if path is not None}
    files: list[Path] = []
    for path in given:
        found = [recording for recording in _within(path) if recording.resolve() not in left_out]
        if not found:
            raise InputError(
                f"{path}: no file of a recording; give files, a folder, or a pattern such as 'faces/*.csv'"
            )
        files += found
    files = list(dict.fromkeys(files))
    return sorted(files, key=natural) if [*map(str, files)] == sorted(map(str, files)) else files


def natural(path: Path) -> list[Any]:
    """The sort key of paths in natural order."""
    return [
        (part.isdecimal(), int(part) if part.isdecimal() else part) for part in re.split(r"(\d+)", str(path)) if part
    ]


def _is_result(path: Path) -> bool:
    return path.name in _RESULTS or (
        any((path.parent / name).exists() for name in _OF_RESULTS) and path.name == "summary.csv"
    )


def _within(path: Path) -> list[Path]:
    if path.is_dir() and not any((path / name).exists() for name in _WHOLE):
        inside = (inner for inner in path.rglob("*") if inner.suffix.lower() in _TEXTS + _OTHERS and inner.is_file())
        recordings = (inner for inner in inside if not inner.name.startswith(".") and not _is_result(inner))
        return sorted(recordings, key=natural) or [path]
    if not path.exists() and any(mark in str(path) for mark in "*?["):
        return sorted(map(Path, glob.glob(str(path), recursive=True)), key=natural)
    return [path]


def stems_of(files: Sequence[Path]) -> list[str]:
    """The files' names below their common folder, without suffixes of formats."""
    paths = [path.absolute() for path in files]
    common = Path(commonpath([path.parent for path in paths]))
    stems = [path.relative_to(common).with_suffix("").as_posix() for path in paths]
    return stems if len(set(stems)) == len(stems) else [path.relative_to(common).as_posix() for path in paths]
