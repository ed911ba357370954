"""Compiled programs, and what else takes long to make, kept on disk between calls.

They are executable code: whoever can write the folder can run code as its owner. So the folder is private, and every entry
carries a SHA-256 of its name and content, which is verified before anything looks inside. An entry that does not verify, or
cannot be used, is removed and made again; each time is told to the logger `tumblecal.program_cache` (level DEBUG).
JAX's own cache has neither: it is given this one in place of its files.
"""

import hashlib
import logging
import os
import stat
import sys
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

import tumblecal
from tumblecal.ground.atomic import written_aside
from tumblecal.ground.errors import InputError


_log = logging.getLogger("tumblecal.program_cache")
_MARK = b"tumblecal program 1\n"
_DIGEST = hashlib.sha256().digest_size


@dataclass(frozen=True)
class ProgramCache:
    """Entries of bytes by name; two of one folder are the same. `get`, `put` and `_path` are what JAX asks of a cache."""

    folder: Path

    @property
    def _path(self) -> Path:
        return self.folder

    def get(self, name: str) -> bytes | None:
        """The content of an entry, None where there is none or it does not verify (it is then removed)."""
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
        """Keep an entry, in place of an older one; a folder that cannot be written keeps none."""
        try:
            with written_aside(self.folder / name) as aside:
                aside.write_bytes(_seal(name, payload) + payload)
        except (OSError, InputError) as error:
            _log.debug("%s: not kept: %s", name, error)

    def discard(self, name: str, reason: object) -> None:
        """Remove an entry that cannot be used."""
        _log.debug("%s: removed: %s", name, reason)
        with suppress(OSError):
            (self.folder / name).unlink(missing_ok=True)

    def keep_newest(self, prefix: str, most: int) -> None:
        """Remove all but the newest entries whose names begin so."""
        with suppress(OSError):
            entries = sorted(self.folder.glob(f"{prefix}*"), key=lambda path: path.stat().st_mtime)
            for path in entries[: max(len(entries) - most, 0)]:
                path.unlink(missing_ok=True)


@lru_cache
def sources_digest(*folders: str) -> str:
    """Digest of what is in these folders of the package, and of the versions of Python, NumPy and JAX."""
    files = sorted(path for folder in folders for path in (Path(tumblecal.__file__).parent / folder).rglob("*.py"))
    versions = (sys.version, *map(version, ("numpy", "jax", "jaxlib")))
    digest = hashlib.sha256("\0".join(versions).encode())
    for path in files:
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _seal(name: str, payload: bytes) -> bytes:
    return _MARK + hashlib.sha256(name.encode() + b"\0" + payload).digest()


_kept: ProgramCache | None = None


def program_cache() -> ProgramCache | None:
    """Where this process keeps its programs; None: nowhere."""
    return _kept


def keep_programs(folder: Path) -> str:
    """Keep the programs of this process, JAX's own included, in `folder`, made private (0700).

    **Returns:** why the folder is not safe, "" where it is; a folder that cannot be made is done without.
    """
    global _kept
    unsafe = ""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        unsafe = _not_private(folder)
        _kept = None if unsafe else ProgramCache(folder)
    except OSError as error:
        _log.debug("%s: %s", folder, error.strerror)
        _kept = None
    _serve_jax(_kept)
    return unsafe


def _not_private(folder: Path) -> str:
    """Why a folder is not its user's alone, "" where it is; one that others can only read is closed to them."""
    about = folder.stat()
    if hasattr(os, "geteuid") and about.st_uid != os.geteuid():
        return f"{folder}: belongs to another user"
    if os.name == "posix" and about.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return f"{folder}: other users can write it"
    if os.name == "posix" and stat.S_IMODE(about.st_mode) != 0o700:
        folder.chmod(0o700)
    return ""


def _serve_jax(cache: ProgramCache | None) -> None:
    """Let JAX keep its executables here; where this version of JAX has no such place, or nothing is kept, it keeps none."""
    import jax

    try:
        from jax._src import compilation_cache

        compilation_cache.reset_cache()
        _ = compilation_cache.get_file_cache
        compilation_cache.get_file_cache = lambda path: None if cache is None else (cache, path)  # type: ignore
    except (ImportError, AttributeError) as error:
        _log.debug("JAX keeps no executables: %s", error)
        cache = None
    jax.config.update("jax_compilation_cache_dir", None if cache is None else str(cache.folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
