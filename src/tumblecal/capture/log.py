"""The append-only record log, the common format of raw bytes, events and the journal.

A record is: magic (4 bytes), kind (4), payload length (4), host stamp in ns (8), CRC-32 (4) over kind to
stamp and the payload, payload; little-endian. A crash can only leave an unfinished record at the end; the next
writer cuts it off. Damage further in is skipped and reported, never read as data.
"""

import contextlib
import fcntl
import json
import os
import re
import struct
import time
import zlib
from collections.abc import Iterator
from enum import IntEnum
from pathlib import Path
from typing import Any, NamedTuple

from tumblecal.ground.errors import InputError
from tumblecal.ground.unwritable import FULL


MAGIC = b"\xa7TC\x01"
_HEADER = struct.Struct("<4sIIqI")
HEADER_SIZE = _HEADER.size
_LARGEST_PAYLOAD = 1 << 24


class RecordKind(IntEnum):
    """Contents of a record: bytes as read from the port, an event (JSON), or a journal entry (JSON)."""

    BYTES = 1
    EVENT = 2
    JOURNAL = 3


class Record(NamedTuple):
    """One record; `offset` is its place in the file, `stop` the place just after it."""

    offset: int
    stop: int
    kind: int
    stamp_ns: int
    payload: bytes

    def content(self) -> dict[str, Any]:
        """The payload of an event or journal entry."""
        return json.loads(self.payload)


def _check(kind: int, stamp_ns: int, payload: bytes) -> int:
    return zlib.crc32(payload, zlib.crc32(struct.pack("<IIq", kind, len(payload), stamp_ns)))


@contextlib.contextmanager
def _disk_faults(path: Path) -> Iterator[None]:
    """Convert errors of the disk to `InputError`. They are not retried: the kernel may have dropped the data."""
    try:
        yield
    except OSError as error:
        why = "the disk is full" if error.errno in FULL else f"cannot be written any more ({error.strerror})"
        raise InputError(
            f"{path}: {why}; recording stopped, everything before is stored. Make room or check the disk, then --resume"
        ) from error


class LogReader:
    """Reads a log from the beginning or any record on, also while another process appends to it.

    **Arguments:**

    - `path`: the log.
    - `start`: first byte.

    `position`: end of the complete records read so far; `damaged`: stretches (start, stop) without a record.
    """

    position: int

    def __init__(self, path: Path, start: int = 0):
        self.path, self.position = path, start
        self.damaged: list[tuple[int, int]] = []
        self._descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)

    def stat(self) -> os.stat_result:
        """Identity of the file: device and inode."""
        return os.fstat(self._descriptor)

    def sync(self) -> None:
        """Write the data appended so far to the disk.

        **Raises:** `InputError` if the disk fails.
        """
        with _disk_faults(self.path):
            os.fdatasync(self._descriptor)

    def faults(self) -> Iterator[str]:
        """Parts without a record, in words, after all are read: stretches within, and an unfinished record at the end."""
        for start, stop in self.damaged:
            yield f"bytes {start} to {stop} are damaged; the data there are lost"
        if (size := self.stat().st_size) > self.position:
            yield f"the file ends within a record: {size - self.position} bytes from byte {self.position} on are incomplete"

    def records(self, stop: int | None = None) -> Iterator[Record]:
        """All complete records from `position` on (to `stop`) that exist now."""
        while True:
            record = self._record_at(self.position)
            if record is None:
                # Damage: continue at the next complete record, if there is one (yet).
                rest = os.pread(self._descriptor, 2 * _LARGEST_PAYLOAD, self.position + 1)
                marks = (self.position + 1 + mark.start() for mark in re.finditer(re.escape(MAGIC), rest))
                record = next(filter(None, map(self._record_at, marks)), None)
            if record is None or (stop is not None and record.stop > stop):
                return
            if record.offset > self.position:
                self.damaged.append((self.position, record.offset))
            self.position = record.stop
            yield record

    def _record_at(self, at: int) -> Record | None:
        """The record at a place; None if there is no complete and valid one."""
        header = os.pread(self._descriptor, HEADER_SIZE, at)
        if len(header) < HEADER_SIZE or not header.startswith(MAGIC):
            return None
        _, kind, length, stamp, check = _HEADER.unpack(header)
        payload = os.pread(self._descriptor, min(length, _LARGEST_PAYLOAD), at + HEADER_SIZE)
        whole = len(payload) == length and _check(kind, stamp, payload) == check
        return Record(at, at + HEADER_SIZE + length, kind, stamp, payload) if whole else None


def read_log(path: Path, start: int = 0, stop: int | None = None, faults: list[str] | None = None) -> list[Record]:
    """All complete records of a log, or of a stretch of it; `faults` receives a line for each part without a record.

    **Raises:** `InputError` if the file cannot be read.
    """
    try:
        with contextlib.closing(LogReader(path, start)) as reader:
            records = list(reader.records(stop))
            if faults is not None:
                faults += [f"{path.name}: {words}" for words in reader.faults()]
            return records
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


class LogWriter:
    """Appends records; opening cuts off an unfinished record that a crash left at the end.

    **Arguments:**

    - `path`: the log; created if it does not exist.
    - `patience_s`: time to wait for another writer that is ending, s.

    `cut`: number of bytes cut off; `position`: end of the log.

    **Raises:** `InputError` if another process writes this log, or the file cannot be created.
    """

    position: int
    cut: int

    def __init__(self, path: Path, patience_s: float = 0.0):
        self.path = path
        try:
            self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror})") from error
        try:
            self._lock(time.monotonic() + patience_s)
        except InputError:
            os.close(self._descriptor)
            raise
        with contextlib.closing(LogReader(path)) as reader:
            for _ in reader.records():
                pass
            self.position, self.cut = reader.position, reader.stat().st_size - reader.position
        if self.cut:
            os.ftruncate(self._descriptor, self.position)
            os.fsync(self._descriptor)
        folder = os.open(path.parent, os.O_RDONLY)
        os.fsync(folder)
        os.close(folder)

    def _lock(self, deadline_s: float) -> None:
        """Take the lock of the kernel, which is released when its process ends for any reason."""
        while True:
            try:
                return fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                if time.monotonic() > deadline_s:
                    raise InputError(
                        f"{self.path}: another capture is writing this log; end it first, or give another folder"
                    ) from error
                time.sleep(0.02)
            except OSError as error:
                raise InputError(
                    f"{self.path}: cannot be locked ({error.strerror}); give a folder on a local disk"
                ) from error

    def append(self, kind: RecordKind, payload: bytes, stamp_ns: int) -> int:
        """Append one record and return the place just after it.

        **Raises:** `InputError` if the disk is full or fails; the log then ends with the last whole record.
        """
        header = _HEADER.pack(MAGIC, kind, len(payload), stamp_ns, _check(kind, stamp_ns, payload))
        data, written = header + payload, 0
        with _disk_faults(self.path):
            try:
                while written < len(data):
                    written += os.write(self._descriptor, data[written:])
            except OSError:
                with contextlib.suppress(
                    OSError
                ):  # a disk that fails keeps the torn record; the next writer cuts it off
                    os.ftruncate(self._descriptor, self.position)
                raise
        self.position += len(data)
        return self.position

    def append_json(self, kind: RecordKind, content: dict[str, Any], stamp_ns: int) -> int:
        """Append an event or journal entry and put it on the disk."""
        stop = self.append(kind, json.dumps(content, separators=(",", ":")).encode(), stamp_ns)
        self.sync()
        return stop

    def sync(self) -> None:
        """Write everything to the disk.

        **Raises:** `InputError` if the disk fails.
        """
        with _disk_faults(self.path):
            os.fdatasync(self._descriptor)

    def check(self) -> None:
        """Check that this log still exists at its path: writing into a deleted file raises no error.

        **Raises:** `InputError` if it was deleted or moved, or its folder can no longer be written.
        """
        # This check comes first: a log deleted between the two checks was not made read-only.
        writable = os.access(self.path.parent, os.W_OK) and os.access(self.path, os.W_OK)
        own = os.fstat(self._descriptor)
        try:
            there = os.path.samestat(self.path.stat(), own)
        except OSError:
            there = False
        if not there:
            moved = Path(f"/proc/self/fd/{self._descriptor}")
            if not own.st_nlink or not moved.exists():
                words = "was deleted while capturing; recording stopped, and this file is lost. Begin a new run"
            else:
                folder = moved.resolve().parent
                words = f"was moved while capturing; recording stopped, all data before are stored: --resume {folder}"
            raise InputError(f"{self.path}: {words}")
        if not writable:
            raise InputError(
                f"{self.path.parent}: was made read-only while capturing; recording stopped, everything before is "
                "kept. Make it writable, then --resume"
            )

    def close(self) -> None:
        """Write everything to the disk and release the log for other writers.

        **Raises:** `InputError` if the disk fails.
        """
        try:
            self.sync()
        finally:
            os.close(self._descriptor)
