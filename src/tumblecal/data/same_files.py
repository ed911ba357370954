"""Files that are the same file, or hold the same."""

import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path

from tumblecal.ground.errors import InputError


def identity(path: Path) -> tuple[int, int]:
    """What two names of one file have in common."""
    status = path.stat()
    return status.st_dev, status.st_ino


def given_once(files: Sequence[Path]) -> list[str]:
    """Check that no file is given twice, under whatever name; one that is not there is left to its reader.

    **Returns:** words on each file that holds the same as another.

    **Raises:** `InputError` naming both names of a file.
    """
    there = [path for path in files if path.is_file()]
    first: dict[tuple[int, int], Path] = {}
    twice = [(path, before) for path in there if (before := first.setdefault(identity(path), path)) is not path]
    if twice:
        raise InputError(
            [
                f"{path}: given twice{f', the first time as {before}' if before != path else ''}; give each file once"
                for path, before in twice
            ]
        )
    return [
        f"{path}: holds the same as {before}, as if it had been measured twice; leave one of them out"
        for path, before in _copies(there)
    ]


def _copies(files: Iterable[Path]) -> list[tuple[Path, Path]]:
    """Each file that holds the same as one before it, and that one; only files of one size are read."""
    by_size: dict[int, list[Path]] = {}
    for path in files:
        by_size.setdefault(path.stat().st_size, []).append(path)
    first: dict[bytes, Path] = {}
    alike = [path for group in by_size.values() if len(group) > 1 for path in group]
    found = [(path, first.setdefault(hashlib.sha256(path.read_bytes()).digest(), path)) for path in alike]
    return [(path, before) for path, before in found if path is not before]
