"""Parquet tables with their metadata; those of tumblecal have a checksum of the whole file."""

import mmap
import re
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.ground.decoding import damaged, decoding, silenced
from tumblecal.ground.errors import InputError
from tumblecal.ground.plain_text import CONTROLS, first_control
from tumblecal.ground.result_set import require_whole
from tumblecal.ground.text_file import shown


if TYPE_CHECKING:
    import polars as pl

# Rows in one piece: of text and Python objects, and of Parquet, whose columns need less memory.
PIECE_ROWS, PARQUET_ROWS = 1 << 16, 1 << 18
_KIND = "Parquet file"
# Metadata key for the CRC-32 of the file, computed with zeros in place of its eight digits.
CHECKSUM, _NOT_YET = "tumblecal_crc32", "crc32=00000000"
_WRITTEN = re.compile("crc32=[0-9a-f]{8}")
# Name of the writer: a file rewritten by another program keeps the metadata, but its bytes differ.
_WRITER = b"Polars"
_PIECE = 1 << 24


def metadata_of(comments: Mapping[str, str]) -> dict[str, str]:
    """The metadata of a table to write, with a placeholder for the checksum of `put_checksum`."""
    return {**comments, CHECKSUM: _NOT_YET}


def put_checksum(path: Path) -> None:
    """Enter the checksum into a file written with `metadata_of`."""
    with path.open("r+b") as file, mmap.mmap(file.fileno(), 0) as content:
        at = content.rfind(_NOT_YET.encode())
        content[at : at + len(_NOT_YET)] = f"crc32={_crc32(content):08x}".encode()


def _crc32(content: mmap.mmap) -> int:
    value = 0
    for first in range(0, len(content), _PIECE):
        value = zlib.crc32(content[first : first + _PIECE], value)
    return value


def _check(path: Path, stated: str) -> None:
    """Compare a file with the checksum in its metadata.

    **Raises:** `InputError` if they differ.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY) as content:
        if content.rfind(_WRITER) < 0:
            return
        at = content.rfind(stated.encode())
        content[at : at + len(_NOT_YET)] = _NOT_YET.encode()
        if not _WRITTEN.fullmatch(stated) or f"crc32={_crc32(content):08x}" != stated:
            raise damaged(path, _KIND, "the checksum differs, so the bytes have changed since tumblecal wrote them")


def scan_parquet(path: Path, *, check: bool = True) -> tuple["pl.LazyFrame", int, dict[str, str]]:
    """The table of a Parquet file, not read yet, its number of rows, and its `key: value` metadata.

    **Arguments:**

    - `check`: compare the checksum, if there is one; not necessary directly after writing.

    **Raises:** `InputError` for a missing file, a file that is not Parquet or was changed, and control characters in names
    or metadata.
    """
    import polars as pl

    if not path.exists():
        raise InputError(f"{path}: no such file")
    require_whole(path)
    with _decoded(path):
        metadata, table = pl.read_parquet_metadata(path), pl.scan_parquet(path, glob=False)
        rows = int(table.select(pl.len()).collect().item())
    if check and (stated := metadata.get(CHECKSUM)):
        _check(path, stated)
    comments = {key: value for key, value in metadata.items() if key != CHECKSUM and not key.startswith("ARROW")}
    for text in (*table.collect_schema().names(), *comments, *comments.values()):
        if first_control(text) is not None:
            raise InputError(f"{path}: the name or comment {shown(text)} has control characters; remove them")
    return table, rows, comments


@contextmanager
def _decoded(path: Path) -> Iterator[None]:
    """Decode without the backtrace that native threads of polars print for a damaged file."""
    with decoding(path, _KIND), silenced():
        yield


def read_parquet(path: Path, *, check: bool = True) -> tuple["pl.DataFrame", dict[str, str]]:
    """The table of a Parquet file, and its `key: value` metadata.

    **Arguments, raises:** as `scan_parquet`.
    """
    table, _, comments = scan_parquet(path, check=check)
    with _decoded(path):
        whole = table.collect()
    require_plain_texts(path, whole)
    return whole, comments


def require_plain_texts(path: Path, rows: "pl.DataFrame", before: int = 0) -> None:
    """Reject texts with control characters in rows that follow `before` other rows.

    **Raises:** `InputError` naming the first.
    """
    import polars as pl

    for name in rows.select(pl.selectors.string()).columns:
        at = rows[name].str.contains(CONTROLS).fill_null(value=False).arg_max() if len(rows) else None
        if at is not None and first_control(rows[name][at] or "") is not None:
            raise InputError(
                f"{path}:row {before + at + 1}, column {name}: {shown(rows[name][at])} has control characters"
            )


def parquet_pieces(path: Path, table: "pl.LazyFrame") -> Iterator["pl.DataFrame"]:
    """The rows of the table of a Parquet file in order, in pieces.

    **Raises:** `InputError` for damaged rows, or a text with control characters.
    """
    pieces, before = pieces_in_order(table), 0
    while True:
        with _decoded(path):
            piece = next(pieces, None)
        if piece is None:
            return
        require_plain_texts(path, piece, before)
        before += len(piece)
        yield piece


def pieces_in_order(table: "pl.LazyFrame") -> Iterator["pl.DataFrame"]:
    """The rows of a table that is not read yet, in order, in pieces of about `PARQUET_ROWS`; one empty piece if it is empty."""
    batches = table.collect_batches(chunk_size=PARQUET_ROWS, lazy=True)
    first = next(batches, None)
    yield table.head(0).collect() if first is None else first
    yield from batches
