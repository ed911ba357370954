"""Parquet tables with what their metadata say; those that tumblecal writes carry a checksum of the whole file."""

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

# Rows at a time: of text and of what Python reads, and of Parquet, whose columns need less room.
PIECE_ROWS, PARQUET_ROWS = 1 << 16, 1 << 18
_KIND = "Parquet file"
# The metadata's entry for the CRC-32 of the file, in which these eight digits count as zeros.
CHECKSUM, _NOT_YET = "tumblecal_crc32", "crc32=00000000"
_WRITTEN = re.compile("crc32=[0-9a-f]{8}")
# Polars' name as the writer: what another program has rewritten keeps metadata, and its bytes are others.
_WRITER = b"Polars"
_PIECE = 1 << 24


def metadata_of(comments: Mapping[str, str]) -> dict[str, str]:
    """The metadata of a table to be written, with room for the checksum that `put_checksum` enters."""
    return {**comments, CHECKSUM: _NOT_YET}


def put_checksum(path: Path) -> None:
    """Enter the checksum into a file that was written with `metadata_of`."""
    with path.open("r+b") as file, mmap.mmap(file.fileno(), 0) as content:
        at = content.rfind(_NOT_YET.encode())
        content[at : at + len(_NOT_YET)] = f"crc32={_crc32(content):08x}".encode()


def _crc32(content: mmap.mmap) -> int:
    value = 0
    for first in range(0, len(content), _PIECE):
        value = zlib.crc32(content[first : first + _PIECE], value)
    return value


def _check(path: Path, stated: str) -> None:
    """Compare a file with the checksum that its metadata state.

    **Raises:** `InputError` where they differ.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY) as content:
        if content.rfind(_WRITER) < 0:
            return
        at = content.rfind(stated.encode())
        content[at : at + len(_NOT_YET)] = _NOT_YET.encode()
        if not _WRITTEN.fullmatch(stated) or f"crc32={_crc32(content):08x}" != stated:
            raise damaged(path, _KIND, "its bytes are not those that tumblecal wrote: the checksum differs")


def scan_parquet(path: Path, *, check: bool = True) -> tuple["pl.LazyFrame", int, dict[str, str]]:
    """A Parquet file's table, not read yet, its number of rows, and its `key: value` metadata.

    **Arguments:**

    - `check`: compare the checksum, where there is one; not needed for what was written a moment ago.

    **Raises:** `InputError` when it is missing, is not such a file, was changed, or names and metadata have
    control characters.
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
    kept = {key: value for key, value in metadata.items() if key != CHECKSUM and not key.startswith("ARROW")}
    for text in (*table.collect_schema().names(), *kept, *kept.values()):
        if first_control(text) is not None:
            raise InputError(f"{path}: the name or comment {shown(text)} has control characters; remove them")
    return table, rows, kept


@contextmanager
def _decoded(path: Path) -> Iterator[None]:
    """Polars' native threads print a backtrace of their own when a damaged file makes them panic."""
    with decoding(path, _KIND), silenced():
        yield


def read_parquet(path: Path, *, check: bool = True) -> tuple["pl.DataFrame", dict[str, str]]:
    """A Parquet file's table, and its `key: value` metadata.

    **Arguments, raises:** as `scan_parquet`.
    """
    table, _, comments = scan_parquet(path, check=check)
    with _decoded(path):
        whole = table.collect()
    require_plain_texts(path, whole)
    return whole, comments


def require_plain_texts(path: Path, rows: "pl.DataFrame", before: int = 0) -> None:
    """Refuse texts with control characters in rows, `before` of which come before them.

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
    """The rows of a Parquet file's table in order, a piece at a time.

    **Raises:** `InputError` where what is read then is damaged, or a text has control characters.
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


def pieces_in_order(table: "pl.LazyFrame", rows: int = PARQUET_ROWS) -> Iterator["pl.DataFrame"]:
    """The rows of a table that is not read yet, in order, about `rows` at a time; an empty one gives one empty piece."""
    batches = table.collect_batches(chunk_size=rows, lazy=True)
    first = next(batches, None)
    yield table.head(0).collect() if first is None else first
    yield from batches
