"""Files that are whole or absent: written aside, brought to disk, then renamed."""

import errno
import os
import re
import secrets
import shutil
import stat
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from tumblecal.ground.errors import InputError
from tumblecal.ground.folder_lock import held, locked, remove_unlocked, unlocked
from tumblecal.ground.plain_text import plain


def writable_folder(folder: Path) -> Path:
    """Make `folder` (and its parents) and check that files can be made in it.

    **Raises:** `InputError` when it cannot be made or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        why = "a file has that name" if folder.is_file() else reason(error)
        raise InputError(f"{folder}: cannot write to this folder ({why}); give another one with --out") from error
    return folder


def writable_file(path: Path) -> None:
    """Check, before the work begins, that a file can be written; its folder is made where it is missing.

    **Raises:** `InputError` when it cannot.
    """
    place = place_of(path)
    if not place.through:
        writable_folder(place.named.parent)


_MOST_LINKS = 40  # as in Linux
# In the name of a file that is being written aside.
_UNFINISHED = ".unfinished"
# Folders in which this process has looked for files of killed ones.
_TIDIED: set[Path] = set()
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextmanager
def output_folders(folders: Sequence[Path], out: Path | None = None) -> Iterator[None]:
    """Make folders before a long computation; those left empty by a failure are removed again.

    **Arguments:**

    - `out`: the folder that has all of them in it, which no other process may write results to meanwhile; the first where
      left out.

    **Raises:** `InputError` when one cannot be made or written, or another process writes its results there.
    """
    new = {path for folder in folders for path in (folder, *folder.parents) if not path.exists()}
    with _empty_removed(new):
        for folder in folders:
            writable_folder(folder)
    # A folder that another process holds is not removed: it may be empty for the moment.
    with held(folders[0] if out is None else out), _empty_removed(new):
        yield


@contextmanager
def _empty_removed(folders: Collection[Path]) -> Iterator[None]:
    """Folders left empty by a failure are removed again."""
    try:
        yield
    except BaseException:
        for path in sorted(folders, key=lambda path: -len(path.parts)):
            with suppress(OSError):
                path.rmdir()
        raise


@contextmanager
def written_aside(path: Path) -> Iterator[Path]:
    """A path beside `path` to write to; it takes the place of `path` when the block ends without an error.

    An interrupt or an error leaves an older `path` as it was, and no half-written file. Of a link the file is written that it
    names, with the rights it had; what is no file (a pipe, a terminal) gets the bytes when the block ends.

    **Raises:** `InputError` when `path` cannot be written, is read-only or a folder.
    """
    place = place_of(path)
    with _begun(place), unwritable_as_fault(path):
        place.begin()
        yield place.aside
        # In this order the name never stands for less than the whole file, not even after a power cut.
        to_disk(place.aside)
        place.take()
        place.keep()


def write_texts(folder: Path, texts: Mapping[str, str]) -> None:
    """Write files of one folder, by their names, as `write_text` writes one, control characters as escapes.

    All are on the disk before the first takes its name, and their names before the return.

    **Raises:** `InputError` as `written_aside`.
    """
    places = [place_of(folder / name) for name in texts]
    with _begun(*places):
        for place, text in zip(places, texts.values(), strict=True):
            with unwritable_as_fault(place.path):
                place.begin()
                with place.aside.open("wb") as file:
                    file.write(plain(text.encode("utf-8", "replace").decode("utf-8")).encode("utf-8"))
                    file.flush()
                    os.fsync(file.fileno())
        for place in places:
            with unwritable_as_fault(place.path):
                place.take()
        for place in {place.named.parent: place for place in places}.values():
            with unwritable_as_fault(place.path):
                place.keep()


def write_text(path: Path, text: str) -> None:
    """Write `text` to `path` in UTF-8 (bytes of a file's name that are not text as ?), whole or not at all.

    **Raises:** `InputError` as `written_aside`.
    """
    write_texts(path.parent, {path.name: text})


@dataclass(frozen=True)
class Place:
    """Where a file is written.

    **Arguments:**

    - `path`: as the user gave it. `named`: what it names, links followed.
    - `aside`: what is written first; nothing has this name.
    - `rights`: of the file that is there, None where there is none.
    - `through`: what is named is no file of a disk, and has to stay.
    """

    path: Path
    named: Path
    aside: Path
    rights: int | None
    through: bool

    def begin(self) -> None:
        """Make the file aside, of its final rights from the start, whoever writes to it."""
        self.aside.touch(exist_ok=False)
        locked(self.aside)
        if self.rights is not None:
            with suppress(OSError):  # a file system without rights
                self.aside.chmod(self.rights)

    def take(self) -> None:
        """What was written aside takes the name, or goes through it."""
        if not self.through:
            os.replace(self.aside, self.named)
            return
        # At the end: of a terminal or a pipe there is no other place, and of a redirected output it keeps what is there.
        with self.aside.open("rb") as written, self.named.open("ab") as file:
            shutil.copyfileobj(written, file)
        self.aside.unlink()

    def keep(self) -> None:
        """Wait until the name is on the disk."""
        if not self.through:
            to_disk(self.named.parent)


def place_of(path: Path) -> Place:
    """Where `path` is written.

    **Raises:** `InputError` for a file that is read-only, a disk, links that go round.
    """
    with unwritable_as_fault(path):
        named, of_process = _followed(path)
        try:
            mode = named.stat().st_mode
        except (FileNotFoundError, NotADirectoryError):
            mode = None
    if mode is not None and stat.S_ISBLK(mode):
        raise InputError(f"{path}: is a disk, not a file on one; give another file")
    rights = stat.S_IMODE(mode) if mode is not None and stat.S_ISREG(mode) and not of_process else None
    # Root may write to anything; what somebody made read-only is meant to stay all the same.
    if rights is not None and not (rights & 0o222 and os.access(named, os.W_OK)):
        raise InputError(f"{path}: is read-only and stays as it is; give another file, or make it writable (chmod u+w)")
    through = mode is not None and rights is None and not stat.S_ISDIR(mode)
    folder = Path(tempfile.gettempdir()) if through else named.parent
    aside = folder / f".{named.name}.{secrets.token_hex(4)}{_UNFINISHED}{path.suffix}"
    return Place(path, named, aside, rights, through)


def _followed(path: Path) -> tuple[Path, bool]:
    """What a path names at the end of its links, and whether that is an open file of a process (/dev/stdout)."""
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
    """Files that are written aside: locked while they are, and removed where they did not take their names."""
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
    """Remove what killed processes were writing aside in a folder; nobody has locked that any more."""
    _TIDIED.add(folder)
    for path in folder.glob(f".*{_UNFINISHED}*"):
        if path.stem.endswith(_UNFINISHED) or path.suffix == _UNFINISHED:
            remove_unlocked(path)


@contextmanager
def unwritable_as_fault(path: Path) -> Iterator[None]:
    """The system's refusal as an error of the user's input."""
    try:
        yield
    except Exception as error:
        refused = _refused_by_system(error)
        if refused is None:
            raise
        raise _unwritable(path, refused) from error


def to_disk(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk."""
    if path.is_dir() and os.name != "posix":
        return
    descriptor = os.open(path, os.O_RDONLY if os.name == "posix" else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _unwritable(path: Path, error: OSError) -> InputError:
    if error.errno in _FULL:
        return InputError(f"{path}: not written, the disk is full (or has no room for so large a file); make room")
    return InputError(f"{path}: cannot be written ({reason(error)}); give another file")


def _refused_by_system(error: Exception) -> OSError | None:
    """The system's error, also out of an error of Polars, which only words it: `... (os error 28)`."""
    if isinstance(error, OSError) and error.errno is not None:
        return error
    number = re.search(r"\(os error (\d+)\)", str(error))
    if number:
        return OSError(int(number[1]), os.strerror(int(number[1])))
    return error if isinstance(error, OSError) else None


def reason(error: OSError) -> str:
    """Why the system refused; libraries leave `strerror` out."""
    return error.strerror or (str(error).splitlines() or ["unknown error"])[0]
