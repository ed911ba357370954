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
from typing import NamedTuple

from tumblecal.capture.decoding.samples import Entry
from tumblecal.ground.errors import InputError
from tumblecal.ground.unwritable import FULL


MAGIC = b"\xa7TC\x01"
_HEADER, _CHECKED = struct.Struct("<4sIIqI"), struct.Struct("<IIq")
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

    def content(self) -> Entry:
        """The payload of an event or journal entry."""
        return json.loads(self.payload)


def _check(kind: int, stamp_ns: int, payload: bytes) -> int:
    return zlib.crc32(payload, zlib.crc32(_CHECKED.pack(kind, len(payload), stamp_ns)))


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

    - `path`: the log. `start`: first byte.

    `position`: end of the complete records read so far; `damaged`: stretches (start, stop) without a record.
    """

    def __init__(self, path: Path, start: int = 0):
        self.path, self.position, self.damaged = path, start, list[tuple[int, int]]()
        self._descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)

    def stat(self) -> os.stat_result:
        """Identity and size of the file."""
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
        header = os.pread(self._descriptor, _HEADER.size, at)
        if len(header) < _HEADER.size or not header.startswith(MAGIC):
            return None
        _, kind, length, stamp, check = _HEADER.unpack(header)
        payload = os.pread(self._descriptor, min(length, _LARGEST_PAYLOAD), at + _HEADER.size)
        whole = len(payload) == length and _check(kind, stamp, payload) == check
        return Record(at, at + _HEADER.size + length, kind, stamp, payload) if whole else None


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

    def __init__(self, path: Path, patience_s: float = 0.0):
        self.path, deadline_s = path, time.monotonic() + patience_s
        try:
            self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror})") from error
        # The kernel releases this lock when its process ends for any reason.
        while why := self._locked():
            if time.monotonic() > deadline_s:
                os.close(self._descriptor)
                raise InputError(f"{path}: {why}")
            time.sleep(0.02)
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

    def _locked(self) -> str:
        """Take the lock; returns why that is not possible, or an empty text."""
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return ""
        except BlockingIOError:
            return "another capture is writing this log; end it first, or give another folder"
        except OSError as error:
            return f"cannot be locked ({error.strerror}); give a folder on a local disk"

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
                # A disk that fails keeps the torn record; the next writer cuts it off.
                with contextlib.suppress(OSError):
                    os.ftruncate(self._descriptor, self.position)
                raise
        self.position += len(data)
        return self.position

    def append_json(self, kind: RecordKind, content: Entry, stamp_ns: int) -> None:
        """Append an event or journal entry and put it on the disk."""
        self.append(kind, json.dumps(content, separators=(",", ":")).encode(), stamp_ns)
        self.sync()

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
        file, there = os.fstat(self._descriptor), False
        with contextlib.suppress(OSError):
            there = os.path.samestat(self.path.stat(), file)
        moved = Path(f"/proc/self/fd/{self._descriptor}")
        if not there and file.st_nlink and moved.exists():
            folder = moved.resolve().parent
            words = f"was moved while capturing; recording stopped, all data before are stored: --resume {folder}"
            raise InputError(f"{self.path}: {words}")
        if not there:
            words = "was deleted while capturing; recording stopped, and this file is lost. Begin a new run"
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
