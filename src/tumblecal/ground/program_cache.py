"""Disk cache of compiled programs and other objects that take long to compute.

They are executable code: anybody who can write to the folder could run code as its owner. Therefore the folder is private,
and each entry has a SHA-256 of its name and content, which is verified before use. An invalid or unusable entry is deleted
and regenerated, with a message to the logger `tumblecal.program_cache` (level DEBUG). The cache of JAX has no such checks, so
JAX uses this one.
"""

import hashlib
import logging
import os
import stat
import warnings
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from tumblecal.ground.atomic import written_aside
from tumblecal.ground.errors import InputError


_log = logging.getLogger("tumblecal.program_cache")
_MARK = b"tumblecal program 1\n"
_DIGEST = hashlib.sha256().digest_size


@dataclass(frozen=True)
class ProgramCache:
    """Entries of bytes by name; two caches of one folder are equal. `get`, `put` and `_path`: interface required by JAX."""

    folder: Path

    @property
    def _path(self) -> Path:
        return self.folder

    def get(self, name: str) -> bytes | None:
        """The content of an entry; None if there is none, or if it is invalid (it is then removed)."""
        try:
            content = (self.folder / name).read_bytes()
        except OSError as error:
            _log.debug("%s: %s", name, error.strerror)
            return None
        payload = content[len(_MARK) + _DIGEST :]
        if content[: len(_MARK) + _DIGEST] != _seal(name, payload):
            self.discard(name, "its checksum is wrong")
            return None
        return payload

    def put(self, name: str, payload: bytes) -> None:
        """Store an entry, in place of an older one; no effect if the folder cannot be written."""
        try:
            with written_aside(self.folder / name) as aside:
                aside.write_bytes(_seal(name, payload) + payload)
        except (OSError, InputError) as error:
            _log.debug("%s: not stored: %s", name, error)

    def discard(self, name: str, reason: object) -> None:
        """Remove an entry that cannot be used."""
        _log.debug("%s: removed: %s", name, reason)
        with suppress(OSError):
            (self.folder / name).unlink(missing_ok=True)


def _seal(name: str, payload: bytes) -> bytes:
    return _MARK + hashlib.sha256(name.encode() + b"\0" + payload).digest()


_cache: ProgramCache | None = None


def program_cache() -> ProgramCache | None:
    """The cache of this process; None without one."""
    return _cache


def cache_folder() -> Path:
    """Folder of compiled programs: `programs` in `TUMBLECAL_CACHE`, otherwise in the cache of the user."""
    stated = os.environ.get("TUMBLECAL_CACHE")
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return (Path(stated) if stated else Path(base) / "tumblecal") / "programs"


def keep_programs(folder: Path | str | None = None) -> None:
    """Store the compiled programs of this process, with those of JAX, and read those of earlier ones.

    The commands do this. In Python it is off unless this function is called: a new process then needs no compilation.

    **Arguments:**

    - `folder`: made private (0700). If omitted, `programs` in the folder of the environment variable `TUMBLECAL_CACHE`, or in
      the cache of the user.

    **Warns:** of a folder that other users own or can write: programs are executable code, so none is read or stored there. A
    folder that cannot be created is ignored.

    Examples:
        >>> import tempfile
        >>> import tumblecal
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     tumblecal.keep_programs(folder)
    """
    if unsafe := keep_programs_in(cache_folder() if folder is None else Path(folder)):
        warnings.warn(f"{unsafe}: compiled programs are neither read nor stored there", stacklevel=2)


def keep_programs_in(folder: Path) -> str:
    """Store the programs of this process, with those of JAX, in `folder`, made private (0700).

    **Returns:** the reason why the folder is not safe, "" if it is; a folder that cannot be created is ignored.
    """
    global _cache
    unsafe = ""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        unsafe = _not_private(folder)
        _cache = None if unsafe else ProgramCache(folder)
    except OSError as error:
        _log.debug("%s: %s", folder, error.strerror)
        _cache = None
    _serve_jax(_cache)
    return unsafe


def _not_private(folder: Path) -> str:
    """The reason why a folder is not private, "" if it is; a folder that others can only read is made private."""
    about = folder.stat()
    if hasattr(os, "geteuid") and about.st_uid != os.geteuid():
        return f"{folder}: belongs to another user"
    if os.name == "posix" and about.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return f"{folder}: other users can write it"
    if os.name == "posix" and stat.S_IMODE(about.st_mode) != 0o700:
        folder.chmod(0o700)
    return ""


def _serve_jax(cache: ProgramCache | None) -> None:
    """Make JAX store its executables in this cache; without one, or with a version of JAX without this interface, in none."""
    import jax

    from tumblecal.ground.jax_interfaces import store_executables_in

    folder = "" if cache is None else str(cache.folder)
    jax.config.update("jax_compilation_cache_dir", folder if store_executables_in(cache, folder) else None)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
