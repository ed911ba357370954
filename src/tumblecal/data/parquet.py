"""Parquet tables with what their metadata say."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    import polars as pl

# Rows at a time: of text and of what Python reads, and of Parquet, whose columns need less room.
PIECE_ROWS, PARQUET_ROWS = 1 << 16, 1 << 18


@contextmanager
def _native_stderr_closed() -> Iterator[None]:
    """Polars' native threads print a backtrace of their own when a damaged file makes them panic: not for users."""
    sys.stderr.flush()
    kept, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nothing)


def scan_parquet(path: Path) -> tuple["pl.LazyFrame", int, dict[str, str]]:
    """A Parquet file's table, not read yet, its number of rows, and its `key: value` metadata.

    **Raises:** `InputError` when it is missing or is not such a file.
    """
    import polars as pl

    if not path.exists():
        raise InputError(f"{path}: no such file")
    with _parquet_faults(path):
        metadata, table = pl.read_parquet_metadata(path), pl.scan_parquet(path)
        rows = int(table.select(pl.len()).collect().item())
    return table, rows, {key: value for key, value in metadata.items() if not key.startswith("ARROW")}


@contextmanager
def _parquet_faults(path: Path) -> Iterator[None]:
    import polars as pl

    try:
        with _native_stderr_closed():
            yield
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError, ValueError, MemoryError) as error:
        raise InputError(f"{path}: not a Parquet file ({(str(error).splitlines() or ['damaged'])[0]})") from error


def read_parquet(path: Path) -> tuple["pl.DataFrame", dict[str, str]]:
    """A Parquet file's table, and its `key: value` metadata.

    **Raises:** `InputError` when it is missing or is not such a file.
    """
    table, _, comments = scan_parquet(path)
    with _parquet_faults(path):
        return table.collect(), comments


def pieces_in_order(table: "pl.LazyFrame", rows: int = PARQUET_ROWS) -> Iterator["pl.DataFrame"]:
    """The rows of a table that is not read yet, in order, about `rows` at a time; an empty one gives one empty piece."""
    batches = table.collect_batches(chunk_size=rows, lazy=True)
    first = next(batches, None)
    yield table.head(0).collect() if first is None else first
    yield from batches
