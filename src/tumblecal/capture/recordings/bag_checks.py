"""Checks of bags that rosbags does not make: the CRC-32 of MCAP files and the structure of SQLite files."""

import contextlib
import mmap
import sqlite3
import struct
import zlib
from pathlib import Path


MCAP_MAGIC, SQLITE_MAGIC = b"\x89MCAP0\r\n", b"SQLite format 3\x00"
# https://mcap.dev/spec: opcode, length; of the footer the starts of the summary and of its offsets, and the CRC-32.
_FOOTER, _DATA_END = struct.Struct("<BQQQI"), struct.Struct("<BQI")
_FOOTER_CODE, _DATA_END_CODE, _CRC_SIZE = 0x02, 0x0F, 4
_PIECE = 1 << 24


def check_bag(path: Path) -> None:
    """Check the files of a bag: `path`, or the files in this folder.

    **Raises:** `ValueError` for a file that is damaged.
    """
    for file in sorted(path.iterdir()) if path.is_dir() else [path]:
        if not file.is_file() or not file.stat().st_size:
            continue
        with file.open("rb") as opened, mmap.mmap(opened.fileno(), 0, access=mmap.ACCESS_READ) as content:
            if content[: len(MCAP_MAGIC)] == MCAP_MAGIC:
                _check_mcap(content)
            elif content[: len(SQLITE_MAGIC)] == SQLITE_MAGIC:
                _check_sqlite(file)


def _check_mcap(content: mmap.mmap) -> None:
    """Compare the CRC-32 of data and summary, if the writer stated them."""
    at = len(content) - len(MCAP_MAGIC) - _FOOTER.size
    if at < 0 or content[-len(MCAP_MAGIC) :] != MCAP_MAGIC:
        raise ValueError("the end of the file is missing")
    code, _, summary, _, stated = _FOOTER.unpack_from(content, at)
    if code != _FOOTER_CODE or not summary <= at:
        raise ValueError("no footer")
    start = summary or at
    if stated and _crc32(content, start, at + _FOOTER.size - _CRC_SIZE) != stated:
        raise ValueError("the CRC-32 of its summary is wrong")
    end = start - _DATA_END.size
    code, _, stated = _DATA_END.unpack_from(content, max(end, 0))
    if code == _DATA_END_CODE and stated and _crc32(content, 0, end) != stated:
        raise ValueError("the CRC-32 of its data is wrong")


def _crc32(content: mmap.mmap, start: int, stop: int) -> int:
    value = 0
    for first in range(start, stop, _PIECE):
        value = zlib.crc32(content[first : min(first + _PIECE, stop)], value)
    return value


def _check_sqlite(path: Path) -> None:
    """Compare the tables with their indices, including the times of messages."""
    with contextlib.closing(sqlite3.connect(f"{path.absolute().as_uri()}?immutable=1", uri=True)) as database:
        try:
            (found,) = database.execute("PRAGMA integrity_check(1)").fetchone()
        except sqlite3.Error as error:
            raise ValueError(str(error)) from error
    if found != "ok":
        raise ValueError(found.splitlines()[-1])
