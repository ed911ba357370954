"""Files that are complete or absent: written under a temporary name, flushed to disk, then renamed."""

import errno
import os
import re
import secrets
import shutil
import stat
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from tumblecal.ground.errors import InputError
from tumblecal.ground.folder_lock import held, locked, remove_unlocked, unlocked
from tumblecal.ground.plain_text import plain
from tumblecal.ground.unwritable import reason, unwritable_as_fault


def writable_folder(folder: Path) -> Path:
    """Create `folder` (and its parents; the target of a link) and check that files can be created in it.

    **Raises:** `InputError` if it cannot be created or written.
    """
    try:
        Path(os.path.realpath(folder)).mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        why = "a file has that name" if folder.is_file() else reason(error)
        raise InputError(f"{folder}: cannot write to this folder ({why}); give a different one with --out") from error
    return folder


def writable_file(path: Path) -> None:
    """Check, before the work begins, that a file can be written; its folder is created if it is missing.

    **Raises:** `InputError` if it cannot.
    """
    place = place_of(path)
    if not place.through:
        writable_folder(place.named.parent)


_MOST_LINKS = 40  # as in Linux
# Part of the temporary name of a file.
_UNFINISHED = ".unfinished"
# Folders in which this process has searched for files of killed processes.
_TIDIED: set[Path] = set()


@contextmanager
def output_folders(folders: Sequence[Path], out: Path | None = None) -> Iterator[None]:
    """Create folders before a long computation; after a failure, empty ones are removed.

    **Arguments:**

    - `out`: the folder with all of them, locked against other processes. Default: the first of the folders.

    **Raises:** `InputError` if one cannot be created or written, or another process writes its results there.
    """
    new = {path for folder in folders for path in (folder, *folder.parents) if not path.exists()}
    with _empty_removed(new):
        for folder in folders:
            writable_folder(folder)
    # A folder that another process has locked is not removed, because it may be temporarily empty.
    with held(folders[0] if out is None else out), _empty_removed(new):
        yield


@contextmanager
def _empty_removed(folders: Collection[Path]) -> Iterator[None]:
    """Remove empty folders after a failure."""
    try:
        yield
    except BaseException:
        for path in sorted(folders, key=lambda path: -len(path.parts)):
            with suppress(OSError):
                path.rmdir()
        raise


@contextmanager
def written_aside(path: Path) -> Iterator[Path]:
    """A temporary path in the folder of `path`, renamed to `path` when the block ends without an error.

    After an interrupt or an error an older `path` is unchanged, and there is no half-written file. Symbolic links are
    followed, and the permissions of the file are kept. Pipes and terminals are written to when the block ends.

    **Raises:** `InputError` if `path` cannot be written, is read-only, or is a folder.
    """
    place = place_of(path)
    with _begun(place), unwritable_as_fault(path):
        place.begin()
        yield place.aside
        # In this order the name always refers to a complete file, also after a power failure.
        to_disk(place.aside)
        place.take()
        place.keep()


def write_texts(folder: Path, texts: Mapping[str, str]) -> None:
    """Write files of one folder, by their names, as in `write_text`, with control characters as escapes.

    All are on disk before the first is renamed, and their names are on disk before the function returns.

    **Raises:** `InputError` as `written_aside`.
    """
    places = [place_of(folder / name) for name in texts]
    with _begun(*places):
        for place, text in zip(places, texts.values(), strict=True):
            with unwritable_as_fault(place.path):
                place.begin()
                place.aside.write_bytes(plain(text.encode("utf-8", "replace").decode("utf-8")).encode("utf-8"))
        # The file system writes all of them at once.
        with ThreadPoolExecutor(max(len(places), 1)) as pool:
            flushed = [(place, pool.submit(to_disk, place.aside)) for place in places]
        for place, done in flushed:
            with unwritable_as_fault(place.path):
                done.result()
        for place in places:
            with unwritable_as_fault(place.path):
                place.take()
        for place in {place.named.parent: place for place in places}.values():
            with unwritable_as_fault(place.path):
                place.keep()


def write_text(path: Path, text: str) -> None:
    """Write `text` to `path` in UTF-8 (bytes of a file name that are not text as ?), completely or not at all.

    **Raises:** `InputError` as `written_aside`.
    """
    write_texts(path.parent, {path.name: text})


@dataclass(frozen=True)
class Place:
    """Paths of a file to write.

    **Arguments:**

    - `path`: as given by the user. `named`: its target, with links followed.
    - `aside`: temporary name, which does not exist yet.
    - `rights`: permissions of the existing file; None if there is none.
    - `through`: whether the target is not a file (a pipe, a terminal), and is written to in place.
    """

    path: Path
    named: Path
    aside: Path
    rights: int | None
    through: bool

    def begin(self) -> None:
        """Create the temporary file, with its final permissions from the start."""
        self.aside.touch(exist_ok=False)
        locked(self.aside)
        if self.rights is not None:
            with suppress(OSError):  # a file system without permissions
                self.aside.chmod(self.rights)

    def take(self) -> None:
        """Rename the temporary file, or copy it to a pipe or terminal."""
        if not self.through:
            os.replace(self.aside, self.named)
            return
        # Append: a redirected output keeps its contents.
        with self.aside.open("rb") as written, self.named.open("ab") as file:
            shutil.copyfileobj(written, file)
        self.aside.unlink()

    def keep(self) -> None:
        """Wait until the name is on disk."""
        if not self.through:
            to_disk(self.named.parent)


def place_of(path: Path) -> Place:
    """The paths for writing `path`.

    **Raises:** `InputError` for a read-only file, a disk, or circular links.
    """
    with unwritable_as_fault(path):
        named, of_process = _followed(path)
        try:
            mode = named.stat().st_mode
        except (FileNotFoundError, NotADirectoryError):
            mode = None
    if mode is not None and stat.S_ISBLK(mode):
        raise InputError(f"{path}: is a disk, not a file; give a different file")
    rights = stat.S_IMODE(mode) if mode is not None and stat.S_ISREG(mode) and not of_process else None
    # Root can write to any file, but a read-only file must not change.
    if rights is not None and not (rights & 0o222 and os.access(named, os.W_OK)):
        raise InputError(
            f"{path}: is read-only, and was not changed; give a different file, or make it writable (chmod u+w)"
        )
    through = mode is not None and rights is None and not stat.S_ISDIR(mode)
    folder = Path(tempfile.gettempdir()) if through else named.parent
    aside = folder / f".{named.name}.{secrets.token_hex(4)}{_UNFINISHED}{path.suffix}"
    return Place(path, named, aside, rights, through)


def _followed(path: Path) -> tuple[Path, bool]:
    """The target of a path with links followed, and whether it is an open file of a process (/dev/stdout)."""
    for _ in range(_MOST_LINKS):
        path = Path(os.path.realpath(path.parent), path.name)
        if path.parent.name == "fd" and path.is_relative_to("/proc"):
            return path, True
        if not path.is_symlink():
            return path, False
        path = path.parent / path.readlink()
    raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))


@contextmanager
def _begun(*places: Place) -> Iterator[None]:
    """Lock temporary files while they are written, and remove those that were not renamed."""
    for folder in {place.aside.parent for place in places} - _TIDIED:
        _tidy(folder)
    try:
        yield
    except BaseException:
        for place in places:
            with suppress(OSError):
                place.aside.unlink()
        raise
    finally:
        for place in places:
            unlocked(place.aside)


def _tidy(folder: Path) -> None:
    """Remove the temporary files of killed processes in a folder, which are not locked."""
    _TIDIED.add(folder)
    for path in folder.glob(f".*{_UNFINISHED}*"):
        if path.stem.endswith(_UNFINISHED) or path.suffix == _UNFINISHED:
            remove_unlocked(path)


@contextmanager
def scratch_folder(source: Path) -> Iterator[Path]:
    """A folder for temporary files, removed after the block.

    **Raises:** `InputError` of the block; a fault of a temporary file, whose path no longer exists, names `source`, the file
    that is processed.
    """
    with tempfile.TemporaryDirectory() as folder:
        try:
            yield Path(folder)
        except InputError as error:
            if type(error) is not InputError or not any(fault.startswith(folder) for fault in error.faults):
                raise
            inside = re.compile(rf"{re.escape(folder)}[^:]*")
            words = f"{source}: temporary file in {tempfile.gettempdir()}"
            raise InputError([inside.sub(lambda _: words, fault) for fault in error.faults]) from error


def to_disk(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on disk."""
    if path.is_dir() and os.name != "posix":
        return
    descriptor = os.open(path, os.O_RDONLY if os.name == "posix" else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
