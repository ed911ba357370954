"""Parquet tables."""

from collections.abc import Iterator, Sequence

import polars as pl

from tumblecal.data.parquet import parquet_pieces, scan_parquet
from tumblecal.recordings.table import Reader, Source, Table


def _read(source: Source) -> list[Table]:
    table, rows, comments = scan_parquet(source.path)

    def pieces(columns: Sequence[str]) -> Iterator[pl.DataFrame]:
        yield from parquet_pieces(source.path, table.select(columns))

    return [Table("", tuple(table.collect_schema().names()), pieces, rows, stated=comments, sheet=True)]


READER = Reader("Parquet", lambda path, head: head.startswith(b"PAR1"), _read)
