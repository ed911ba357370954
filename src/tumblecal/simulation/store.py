"""Where a study's finished chunks are kept, so that it can be stopped at any moment and go on."""

import fcntl
import hashlib
import json
import platform
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from tumblecal.data.atomic import writable_folder, write_text, written_aside
from tumblecal.errors import InputError


def identity(study: Mapping[str, Any]) -> dict[str, Any]:
    """What decides the bits of a study: its tables, the versions that compute them, the kind of device."""
    import jax

    tables = {name: study[name] for name in ("kind", "study", "rig")}
    if "effects" in study:
        tables["effects"] = [one["text"] for one in study["effects"]]
    return {
        **tables,
        "versions": {name: version(name) for name in ("tumblecal", "jax", "numpy")},
        "device": jax.devices()[0].device_kind,
        "machine": platform.machine(),
    }


class Store:
    """The folder of one study: `manifest.json`, `chunks/`."""

    def __init__(self, folder: Path, study: Mapping[str, Any], chunks: int):
        """Open the folder, or make it.

        **Raises:** `InputError` when it holds another study, one that other versions began, or one that is running.
        """
        self.folder, self.chunks = folder, chunks
        self._manifest = folder / "manifest.json"
        mine = identity(study)
        text = json.dumps(mine, sort_keys=True)
        content = {"schema": "tumblecal.study/1", "hash": hashlib.sha256(text.encode()).hexdigest(), "chunks": chunks}
        writable_folder(folder / "chunks")
        self._lock = self._locked()
        try:
            self._compare(content["hash"], mine)
        except InputError:
            self.close()
            raise
        if not self._manifest.exists():
            write_text(self._manifest, json.dumps(content | {"identity": mine}, indent=1))

    def _locked(self) -> TextIO:
        """Keep other processes out until `close`; the system lets go when the process dies."""
        lock = (self.folder / ".lock").open("w")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            lock.close()
            raise InputError(
                f"{self.folder}: another process is running this study; wait for it or give another --out"
            ) from error
        # What a killed process was writing.
        for left in (self.folder / "chunks").glob(".*.npz"):
            left.unlink()
        return lock

    def close(self) -> None:
        """Let other processes in."""
        self._lock.close()

    def _compare(self, mine: str, wanted: Mapping[str, Any]) -> None:
        if not self._manifest.exists():
            return
        try:
            there = json.loads(self._manifest.read_text(encoding="utf-8"))
            other = there["identity"]
        except (ValueError, KeyError) as error:
            raise InputError(f"{self._manifest}: not a study's manifest; give another --out") from error
        if there.get("hash") == mine:
            return
        changed = [name for name in wanted if wanted[name] != other.get(name)]
        raise InputError(
            f"{self.folder}: holds another study (different: {', '.join(changed)}); give another --out, or remove "
            f"that folder to start anew"
        )

    def _path(self, chunk: int) -> Path:
        return self.folder / "chunks" / f"{chunk:08d}.npz"

    def missing(self) -> list[int]:
        """Chunks not yet finished. A file that cannot be read counts as not finished."""
        return [chunk for chunk in range(self.chunks) if not self._readable(chunk)]

    def _readable(self, chunk: int) -> bool:
        try:
            with np.load(self._path(chunk)) as arrays:
                return bool(arrays.files)
        except (OSError, ValueError, EOFError):
            return False

    def put(self, chunk: int, arrays: Mapping[str, np.ndarray]) -> None:
        """Keep a finished chunk: whole or not at all."""
        with written_aside(self._path(chunk)) as aside, aside.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)

    def all(self) -> Iterator[dict[str, np.ndarray]]:
        """All chunks in their order, one in memory at a time."""
        for chunk in range(self.chunks):
            with np.load(self._path(chunk)) as arrays:
                yield dict(arrays)
