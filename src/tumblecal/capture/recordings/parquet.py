"""Parquet tables."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.capture.recordings.options import Asked
from tumblecal.capture.recordings.table import PIECE_ROWS, Reader, SourceTable
from tumblecal.data.parquet import scan_parquet


if TYPE_CHECKING:
    import polars as pl


def _read(path: Path, asked: Asked) -> list[SourceTable]:
    table, rows, comments = scan_parquet(path)

    def pieces(columns: Sequence[str]) -> Iterator["pl.DataFrame"]:
        for first in range(0, rows, PIECE_ROWS):
            yield table.slice(first, PIECE_ROWS).select(columns).collect()

    return [SourceTable("", tuple(table.collect_schema().names()), pieces, rows, comments=comments)]


READER = Reader("Parquet", lambda path, head: head.startswith(b"PAR1"), _read)
