"""Storage of a study's finished chunks, so that it can be interrupted at any time and resumed."""

import fcntl
import hashlib
import json
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from tumblecal.ground.atomic import writable_folder, write_text, written_aside
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown
from tumblecal.studies.chunk import (
    TABLES,
    NotThisChunk,
    differences,
    maker,
    statement,
    study_hash,
    tables_of,
    unpacked,
)


def identity(study: Mapping[str, Any]) -> dict[str, Any]:
    """The properties that determine the bits of a study: its tables, versions, and kind of device."""
    return {**tables_of(study), **maker()}


def _changed_tables(recorded: Mapping[str, Any], wanted: Mapping[str, Any]) -> list[str]:
    """The keys of a study's tables that are not the same, with their values where these are short."""
    changed = []
    for name in TABLES:
        old, new = recorded.get(name), wanted.get(name)
        if not (isinstance(old, Mapping) and isinstance(new, Mapping)):
            changed += [name] * (old != new)
            continue
        for key in dict.fromkeys((*old, *new)):
            if key in old and key in new and old[key] == new[key]:
                continue
            short = not any(isinstance(table.get(key), Mapping | list) for table in (old, new))
            before, now = (shown(table[key]) if key in table else "not stated" for table in (old, new))
            changed.append(f"{name}.{key}{f' {before} against {now}' * short}")
    return changed


class Store:
    """The folder of one study: `manifest.json`, `chunks/`."""

    folder: Path
    chunks: int

    def __init__(
        self,
        folder: Path,
        study: Mapping[str, Any],
        chunks: int,
        check: Callable[[int, Mapping[str, np.ndarray]], None] = lambda chunk, arrays: None,
    ):
        """Open the folder, or make it; `check` raises `NotThisChunk` for arrays that cannot belong to the chunk.

        **Raises:** `InputError` if it contains another study, one that other versions began, or one that is running.
        """
        self.folder, self.chunks, self._check = folder, chunks, check
        self._workers = folder / "chunks" / "unverified.txt"
        self._study = study_hash(study)
        self._manifest = folder / "manifest.json"
        mine = identity(study)
        text = json.dumps(mine, sort_keys=True)
        content = {"schema": "tumblecal.study/1", "hash": hashlib.sha256(text.encode()).hexdigest(), "chunks": chunks}
        writable_folder(folder / "chunks")
        self._lock = self._locked()
        try:
            self._compare(mine)
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
        # Unfinished files of a killed process.
        for unfinished in (self.folder / "chunks").glob(".*.npz"):
            unfinished.unlink()
        return lock

    def close(self) -> None:
        """Let other processes in."""
        self._lock.close()

    def _compare(self, wanted: Mapping[str, Any]) -> None:
        if not self._manifest.exists():
            return
        try:
            recorded = json.loads(self._manifest.read_text(encoding="utf-8"))["identity"]
            if recorded == wanted:
                return
            changed = _changed_tables(recorded, wanted)
            changed += differences(
                *({name: of.get(name) for name in ("versions", "device")} for of in (recorded, wanted))
            )
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError(
                f"{self._manifest}: damaged, or not a study's manifest; give another --out, or remove this file: each "
                f"chunk is then checked by its statement"
            ) from error
        raise InputError(
            f"{self.folder}: contains another study (different: {', '.join(changed)}); give another --out, or remove "
            f"that folder to start again"
        )

    def _path(self, chunk: int) -> Path:
        return self.folder / "chunks" / f"{chunk:08d}.npz"

    def missing(self, tell: Callable[[str], object] = warnings.warn) -> list[int]:
        """Chunks not yet finished; files that do not verify count as such, and `tell` is given a line for each cause."""
        missing, refused = [], {}
        for chunk in range(self.chunks):
            try:
                self._arrays(chunk)
            except FileNotFoundError:
                missing.append(chunk)
            except (NotThisChunk, OSError) as error:
                missing.append(chunk)
                refused.setdefault(str(error), []).append(self._path(chunk))
        for cause, (first, *more) in refused.items():
            others = f" and {len(more)} more" if more else ""
            tell(f"{first}{others}: not used, computed again: {cause}")
        return missing

    def _arrays(self, chunk: int) -> dict[str, np.ndarray]:
        arrays = unpacked(self._path(chunk).read_bytes(), statement(self._study, chunk))
        self._check(chunk, arrays)
        return arrays

    def put(self, chunk: int, content: bytes, worker: str | None = None) -> None:
        """Store the bytes of a finished chunk completely or not at all. The `worker` that computed it is recorded first."""
        if worker is not None or self._workers.exists():
            with self._workers.open("a", encoding="utf-8") as file:
                file.write(json.dumps([chunk, worker]) + "\n")
        with written_aside(self._path(chunk)) as aside:
            aside.write_bytes(content)

    def chunk(self, chunk: int) -> dict[str, np.ndarray]:
        """One chunk.

        **Raises:** `InputError` when it was changed since it was written or checked.
        """
        try:
            return self._arrays(chunk)
        except (NotThisChunk, OSError) as error:
            path = self._path(chunk)
            raise InputError(f"{path}: {error}; run the same command again to compute it again") from error

    def unverified(self) -> dict[str, list[int]]:
        """Chunks that workers computed and that no chunk of theirs vouches for yet, by worker; those of an earlier call too."""
        makers: dict[int, str | None] = {}
        with suppress(OSError):
            for line in self._workers.read_text(encoding="utf-8", errors="replace").splitlines():
                with suppress(ValueError, TypeError):  # cut off by a kill
                    number, worker = json.loads(line)
                    makers[int(number)] = worker
        by_worker: dict[str, list[int]] = {}
        for number, worker in sorted(makers.items()):
            if worker is not None and self._path(number).is_file():
                by_worker.setdefault(worker, []).append(number)
        return by_worker

    def remove_of(self, worker: str) -> None:
        """Remove the chunks of a worker that are not verified."""
        for number in self.unverified().get(worker, []):
            self._path(number).unlink(missing_ok=True)

    def forget_workers(self) -> None:
        """All chunks are verified."""
        self._workers.unlink(missing_ok=True)

    def all(self) -> Iterator[dict[str, np.ndarray]]:
        """All chunks in their order, one in memory at a time.

        **Raises:** `InputError` when one was changed since it was written or checked.
        """
        for chunk in range(self.chunks):
            yield self.chunk(chunk)
