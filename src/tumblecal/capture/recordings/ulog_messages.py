"""Check that the messages of a ULog are contiguous to its end; pyulog skips other bytes and a torn end silently.

Format: https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

import mmap
import struct
from pathlib import Path


_HEADER_SIZE = 16
_MESSAGE = struct.Struct("<HB")
_TYPES = frozenset(b"BFIMPQARDLCSO")
# Flag bits: eight bytes of compatible flags, eight of others, three places where a later writer appended data.
_FLAGS = struct.Struct("<8xB7x3Q")
_APPENDED = 1


def message_fault(path: Path) -> str:
    """The first fault in the sequence of messages, in words; "" if there is none."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as log:
        at = start = _HEADER_SIZE
        for stop in (*_appended(log), len(log)):
            at, size = start, 0
            while at + _MESSAGE.size <= stop:
                size, kind = _MESSAGE.unpack_from(log, at)
                if kind not in _TYPES or (kind != ord("S") and not size):
                    return f"byte {at} is not the start of a message: data after it may be lost or wrong"
                if at + _MESSAGE.size + size > stop:
                    break
                at += _MESSAGE.size + size
            start = stop
        # Data may be appended after a crash within a message: only the end of the file shows a truncation.
        if at < len(log):
            return f"the file ends within a message (byte {at} of {len(log)}): data after it are missing"
    return ""


def _appended(log: mmap.mmap) -> list[int]:
    """The places where a later writer appended data."""
    if len(log) < _HEADER_SIZE + _MESSAGE.size + _FLAGS.size:
        return []
    size, kind = _MESSAGE.unpack_from(log, _HEADER_SIZE)
    flags, *places = _FLAGS.unpack_from(log, _HEADER_SIZE + _MESSAGE.size)
    if kind != ord("B") or size < _FLAGS.size or not flags & _APPENDED:
        return []
    return [place for place in places if _HEADER_SIZE < place < len(log)]
