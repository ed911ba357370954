"""Whether the messages of a ULog follow one another to its end: pyulog skips other bytes, and a torn end, without a word.

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
    """Where messages stop following one another, in words; "" where they do so to the end."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as log:
        at = start = _HEADER_SIZE
        for stop in (*_appended(log), len(log)):
            at, size = start, 0
            while at + _MESSAGE.size <= stop:
                size, kind = _MESSAGE.unpack_from(log, at)
                if kind not in _TYPES or (kind != ord("S") and not size):
                    return f"byte {at} begins no message: what follows it may be lost or wrong"
                if at + _MESSAGE.size + size > stop:
                    break
                at += _MESSAGE.size + size
            start = stop
        # Data were appended after a crash where the log ended within a message: only the end of all tells of a cut.
        if at < len(log):
            return f"it ends within a message (byte {at} of {len(log)}): what came after it is missing"
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
