"""Files compressed by gzip: any other format, decompressed into a temporary folder."""

import gzip
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING
from weakref import finalize

from tumblecal.ground.decoding import decoding
from tumblecal.ground.errors import InputError
from tumblecal.recordings.memory import require_size
from tumblecal.recordings.table import Reader, Source, Table


if TYPE_CHECKING:
    import polars as pl

# A text is compressed by at most this factor.
_LARGEST_FACTOR, _PIECE = 50, 1 << 22


def _read(source: Source) -> list[Table]:
    from tumblecal.recordings.formats import tables_of

    folder = Path(tempfile.mkdtemp(prefix="tumblecal-"))
    path, most, size = folder / source.path.stem, _LARGEST_FACTOR * source.path.stat().st_size, 0

    @contextmanager
    def named() -> Iterator[None]:
        """Faults of the temporary file name the compressed one."""
        try:
            yield
        except InputError as error:
            raise InputError([fault.replace(str(path), str(source.path)) for fault in error.faults]) from error

    # The folder is removed when the last table, or the program, ends.
    finalize(named, shutil.rmtree, folder, ignore_errors=True)

    def kept(table: Table) -> Table:
        def pieces(columns: Sequence[str]) -> Iterator["pl.DataFrame"]:
            with named():
                yield from table.pieces(columns)

        return replace(table, pieces=pieces)

    with decoding(source.path, "gzip file"), gzip.open(source.path) as packed, path.open("wb") as file:
        while piece := packed.read(_PIECE):
            size += file.write(piece)
            require_size(source.path, "its contents", size, most, "decompress it with gunzip")
    with named():
        return [kept(table) for table in tables_of(path, source.options, source.damage)[1]]


READER = Reader("gzip", lambda path, head: head.startswith(b"\x1f\x8b"), _read)
