"""The origin of data in the provenance of a result: files with their SHA-256, number of positions, version of the program."""

import hashlib
from pathlib import Path
from typing import Any

from tumblecal import __version__
from tumblecal.data.positions import PositionSet


def source_of(data: PositionSet) -> dict[str, Any]:
    """Source of the data: file, SHA-256 of its content, number of positions, version of the program; for several files, the
    SHA-256 of each."""
    source = {
        "data": data.source,
        "sha256": _digest(data.source),
        "positions": len(data),
        "tumblecal": __version__,
        **({"files": {file: _digest(file) for file in data.files}} if len(data.files) > 1 else {}),
    }
    measured = data.comments.get("measured_utc")
    return source | ({"measured_utc": measured} if measured else {})


def _digest(file: str) -> str | None:
    """None for a folder, or for data that are not from a file."""
    path = Path(file)
    if not path.is_file():
        return None
    with path.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()
