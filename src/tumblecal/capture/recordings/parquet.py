"""Parquet tables."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import polars as pl

from tumblecal.capture.recordings.damage import Damage
from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.capture.recordings.table import Reader, SourceTable
from tumblecal.data.parquet import parquet_pieces, scan_parquet


def _read(path: Path, options: RecordingOptions, damage: Damage) -> list[SourceTable]:
    table, rows, comments = scan_parquet(path)

    def pieces(columns: Sequence[str]) -> Iterator[pl.DataFrame]:
        yield from parquet_pieces(path, table.select(columns))

    return [SourceTable("", tuple(table.collect_schema().names()), pieces, rows, comments=comments, sheet=True)]


READER = Reader("Parquet", lambda path, head: head.startswith(b"PAR1"), _read)
