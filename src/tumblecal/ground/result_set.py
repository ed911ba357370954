"""Sets of results: all files of a set are replaced together, by one process at a time.

The files are written into a hidden folder within the output folder. When all are on disk, the hidden folder is renamed, and the
set is valid. Then all files of the previous set are removed, the folder is renamed again, and the files are moved to their
places; without a previous set, the folder gets its last name at once. If the process is killed at any time, the output folder
has files of one set only. The next set that is written there first completes unfinished steps.
"""

import errno
import fnmatch
import json
import logging
import os
import shutil
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from tumblecal.ground.atomic import place_of, to_disk, writable_folder, written_aside
from tumblecal.ground.errors import InputError, SupplementWarning, one_line
from tumblecal.ground.folder_lock import held, is_held
from tumblecal.ground.unwritable import unwritable_as_fault


# Name of the hidden folder in each of its states, and the file in it that lists the names of the previous set.
_UNFINISHED, _WHOLE, _MOVING = ".tumblecal-unfinished", ".tumblecal-whole", ".tumblecal-moving"
_EARLIER = ".earlier"
_PATIENCE_S = 2.0


@contextmanager
def result_set(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """A temporary folder for a set of results; its files are moved to `folder` when the block ends without an error.

    After an error or an interrupt the existing set is unchanged.

    **Arguments:**

    - `folder`: created if missing. `names`: glob patterns of all files that a set of this kind may have; those of the
      previous set are removed.

    **Raises:** `InputError` if `folder` cannot be written, another process writes to it, or one of its files is read-only.
    """
    writable_folder(folder)
    with held(folder), _named_as(folder):
        finish(folder)
        for path in _earlier(folder, names):
            place_of(path)  # rejected here, before the work, if it is read-only
        aside = folder / _UNFINISHED
        try:
            with unwritable_as_fault(folder):
                aside.mkdir()
            yield aside
            replaces = _state_earlier(folder, aside, names)
            with unwritable_as_fault(folder):
                os.rename(aside, folder / (_WHOLE if replaces else _MOVING))
                to_disk(folder)
                finish(folder)
        except BaseException:
            if (folder / _WHOLE).exists() or (folder / _MOVING).exists():
                finish(folder)  # it is valid already
            shutil.rmtree(aside, ignore_errors=True)
            raise


def finish(folder: Path) -> None:
    """Complete a valid set of a killed process, and remove unfinished files of such processes."""
    whole, moving = folder / _WHOLE, folder / _MOVING
    if whole.is_dir():
        for path in _earlier(folder, json.loads((whole / _EARLIER).read_text("utf-8"))):
            _removed(path)
        to_disk(folder)
        os.rename(whole, moving)
        to_disk(folder)
    if moving.is_dir():
        for path in sorted(path for path in moving.rglob("*") if path.is_file() and path.name != _EARLIER):
            _moved(path, folder / path.relative_to(moving))
        to_disk(folder)
        shutil.rmtree(moving)
    shutil.rmtree(folder / _UNFINISHED, ignore_errors=True)


def final_place(path: Path) -> Path:
    """The final path of a file in an unfinished set; other paths are unchanged."""
    return Path(*(part for part in path.parts if part != _UNFINISHED)) if _UNFINISHED in path.parts else path


def remove_results(folder: Path, names: Sequence[str]) -> None:
    """Remove a set of results, or a summary of several sets, before the first set is replaced.

    **Raises:** `InputError` if a file cannot be removed.
    """
    with unwritable_as_fault(folder):
        for path in _earlier(folder, names):
            _removed(path)


def require_whole(path: Path) -> None:
    """Reject a folder with partly replaced results of a killed process.

    **Raises:** `InputError`.
    """
    folder, deadline = path.parent, time.monotonic() + _PATIENCE_S
    while os.path.exists(folder / _WHOLE) or os.path.exists(folder / _MOVING):
        if time.monotonic() > deadline or not is_held(folder):
            raise InputError(
                f"{folder}: a process was killed while it replaced these results, and some may be missing; run its command "
                "again"
            )
        time.sleep(0.02)


def _earlier(folder: Path, names: Sequence[str]) -> list[Path]:
    """The files of the existing set, by the patterns of their names; each folder is listed once."""
    listed, found = dict[str, list[str]](), list[Path]()
    for parent, pattern in map(os.path.split, names):
        if parent not in listed:
            with suppress(FileNotFoundError, NotADirectoryError):
                listed[parent] = sorted(os.listdir(folder / parent))
        found += [folder / parent / name for name in fnmatch.filter(listed.get(parent, ()), pattern)]
    return [path for path in found if path.is_file() or path.is_symlink()]


def _state_earlier(folder: Path, aside: Path, names: Sequence[str]) -> bool:
    """List the files to remove before the set is moved; new files get the permissions of those that they replace.

    **Returns:** whether there is any such file; otherwise nothing is listed.

    **Raises:** `InputError` for a file that is read-only.
    """
    new = {str(path.relative_to(aside)): path for path in aside.rglob("*") if path.is_file()}
    earlier = _earlier(folder, [*names, *new])
    if not earlier:
        return False
    for path in earlier:
        rights, staged = place_of(path).rights, new.get(str(path.relative_to(folder)))
        if rights is not None and staged is not None:
            with suppress(OSError):
                staged.chmod(rights)
    with written_aside(aside / _EARLIER) as listed:
        listed.write_text(json.dumps([*names, *new]), encoding="utf-8")
    return True


def _removed(path: Path) -> None:
    """Remove a file; for a link its target, so that the link is kept."""
    place = place_of(path)
    if not place.through:
        place.named.unlink(missing_ok=True)


def _moved(staged: Path, path: Path) -> None:
    """Move a file of the new set to its place, as in `written_aside`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        replace(place_of(path), aside=staged).take()
    except OSError as error:
        if error.errno != errno.EXDEV:
            raise
        with written_aside(path) as aside:  # a link to another disk
            shutil.copyfile(staged, aside)


@contextmanager
def _named_as(folder: Path) -> Iterator[None]:
    """Replace temporary names in faults by the final names."""
    try:
        yield
    except InputError as error:
        if str(folder / _UNFINISHED) not in str(error):
            raise
        aside, final = f"{folder / _UNFINISHED}{os.sep}", f"{folder}{os.sep}"
        raise InputError([fault.replace(aside, final) for fault in error.faults]) from error


@contextmanager
def supplement(name: str | Path) -> Iterator[None]:
    """A block that draws a figure or writes a page; an error in it is a `SupplementWarning`, which tests turn into an error.

    **Arguments:**

    - `name`: path of the figure or page, or its name in words.
    """
    try:
        yield
    except Exception as error:
        logging.getLogger(__name__).debug("%s", name, exc_info=True)
        reason = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
        words = f"{final_place(Path(name))} is missing or incomplete ({one_line(reason)}); the results are complete"
        warnings.warn(SupplementWarning(words), stacklevel=3)
