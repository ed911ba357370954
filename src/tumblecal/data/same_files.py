"""Identical files, and files with identical contents."""

import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path

from tumblecal.ground.errors import InputError


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
        raise InputError(
            [
                f"{path}: given twice{f', the first time as {before}' if before != path else ''}; give each file once"
                for path, before in twice
            ]
        )
    return {
        path: f"same contents as {before}, so these positions are used twice; remove one of these files"
        for path, before in _copies(existing)
    }


def _copies(files: Iterable[Path]) -> list[tuple[Path, Path]]:
    """Each file with the same contents as an earlier one, and the earlier one; only files of equal size are read."""
    by_size: dict[int, list[Path]] = {}
    for path in files:
        by_size.setdefault(path.stat().st_size, []).append(path)
    first: dict[bytes, Path] = {}
    of_equal_size = [path for group in by_size.values() if len(group) > 1 for path in group]
    found = [(path, first.setdefault(hashlib.sha256(path.read_bytes()).digest(), path)) for path in of_equal_size]
    return [(path, before) for path, before in found if path is not before]
