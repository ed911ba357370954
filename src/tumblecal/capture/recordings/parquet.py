"""Parquet tables."""

from collections.abc import Iterator, Sequence

import polars as pl

from tumblecal.capture.recordings.table import Reader, Source, SourceTable
from tumblecal.data.parquet import parquet_pieces, scan_parquet


def _read(source: Source) -> list[SourceTable]:
    table, rows, comments = scan_parquet(source.path)

    def pieces(columns: Sequence[str]) -> Iterator[pl.DataFrame]:
        yield from parquet_pieces(source.path, table.select(columns))

    return [SourceTable("", tuple(table.collect_schema().names()), pieces, rows, comments=comments, sheet=True)]


READER = Reader("Parquet", lambda path, head: head.startswith(b"PAR1"), _read)
