"""The files of one recording: folders and patterns replaced by them, in natural order (2 before 10); their names."""

import glob
import re
from collections.abc import Sequence
from os.path import commonpath
from pathlib import Path

from tumblecal.ground.errors import InputError


# In a folder, files with these suffixes are recordings; it may also contain plans, pages and figures.
_SUFFIXES = (
    *(".csv", ".tsv", ".txt", ".dat", ".log", ".asc", ".jsonl", ".xlsx"),
    *(".parquet", ".mat", ".h5", ".hdf5", ".bag", ".db3", ".mcap", ".ulg", ".bin", ".mtb", ".raw"),
)
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
    files = list[Path]()
    for path in given:
        found = [path]
        if path.is_dir() and not any((path / name).exists() for name in _WHOLE):
            found = sorted(filter(_is_recording, path.rglob("*")), key=_natural)
        elif not path.exists() and any(mark in str(path) for mark in "*?["):
            found = sorted(map(Path, glob.glob(str(path), recursive=True)), key=_natural)
        found = [recording for recording in found if recording.resolve() not in left_out]
        if not found:
            raise InputError(
                f"{path}: no file of a recording, and no capture; give files, a folder, or a pattern such as 'faces/*.csv'"
            )
        files += [recording for recording in found if recording not in files]
    return sorted(files, key=_natural) if [*map(str, files)] == sorted(map(str, files)) else files


def _natural(path: Path) -> list[tuple[bool, int, str]]:
    parts = filter(None, re.split(r"(\d+)", str(path)))
    return [(part.isdecimal(), int(part) if part.isdecimal() else 0, part) for part in parts]


def _is_recording(path: Path) -> bool:
    result = path.name == "summary.csv" and any((path.parent / name).exists() for name in _OF_RESULTS)
    hidden = path.name.startswith(".") or path.name in _RESULTS
    return path.suffix.lower() in _SUFFIXES and path.is_file() and not (result or hidden)


def stems_of(files: Sequence[Path]) -> list[str]:
    """The files' names below their common folder, without suffixes of formats."""
    common = commonpath([path.absolute().parent for path in files])
    paths = [path.absolute().relative_to(common) for path in files]
    stems = [path.with_suffix("").as_posix() for path in paths]
    return stems if len(set(stems)) == len(stems) else [path.as_posix() for path in paths]
