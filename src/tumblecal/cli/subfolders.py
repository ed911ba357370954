"""Output folders of a batch."""

from collections.abc import Sequence
from pathlib import Path


def subfolders(files: Sequence[Path], out: Path) -> list[Path]:
    """The folder of each file: `out` itself for one file, else `out/<stem>`, numbered if stems are equal."""
    if len(files) == 1:
        return [out]
    folders: list[Path] = []
    for path in files:
        folder, number = out / path.stem, 1
        while folder in folders:
            number += 1
            folder = out / f"{path.stem}-{number}"
        folders.append(folder)
    return folders
