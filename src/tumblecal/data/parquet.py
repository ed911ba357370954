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


def read_parquet(path: Path) -> tuple["pl.DataFrame", dict[str, str]]:
    """A Parquet file's table, and its `key: value` metadata.

    **Raises:** `InputError` when it is missing or is not such a file.
    """
    import polars as pl

    if not path.exists():
        raise InputError(f"{path}: no such file")
    try:
        with _native_stderr_closed():
            metadata, frame = pl.read_parquet_metadata(path), pl.read_parquet(path)
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError, ValueError, MemoryError) as error:
        raise InputError(f"{path}: not a Parquet file ({(str(error).splitlines() or ['damaged'])[0]})") from error
    return frame, {key: value for key, value in metadata.items() if not key.startswith("ARROW")}
