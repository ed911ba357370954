"""Tables in memory with the places of their rows; archives of numpy arrays (.npz): arrays of one length are a table."""

from collections.abc import Iterator, Sequence

import numpy as np
import polars as pl

from tumblecal.data.parquet import PIECE_ROWS
from tumblecal.data.text_layout import ROW
from tumblecal.ground.decoding import decoding, silenced
from tumblecal.recordings.memory import require_size
from tumblecal.recordings.table import Reader, Source, Table, tables_of_arrays


def of_frame(name: str, frame: pl.DataFrame, **more) -> Table:
    """A table of a frame in memory, which has the column `ROW`; `more`: further fields of `Table`."""

    def pieces(columns: Sequence[str]) -> Iterator[pl.DataFrame]:
        return frame.select(*columns, ROW).iter_slices(PIECE_ROWS)

    return Table(name, tuple(column for column in frame.columns if column != ROW), pieces, len(frame), **more)


def _read(source: Source) -> list[Table]:
    with decoding(source.path, "npz archive"), silenced(), source.path.open("rb") as file:
        archive = np.load(file, allow_pickle=False)
        infos = archive.zip.infolist()
        needed, there = sum(info.file_size for info in infos), source.path.stat().st_size
        require_size(source.path, "its arrays", needed, 100 * there, "save them again")
        return tables_of_arrays({name: archive[name] for name in archive.files})


READER = Reader("numpy .npz", lambda path, head: head.startswith(b"PK") and b".npy" in head[:200], _read)
