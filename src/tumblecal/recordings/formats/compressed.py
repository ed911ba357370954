"""Files compressed by gzip: any other format, decompressed into a temporary folder."""

import gzip
import tempfile
from pathlib import Path

from tumblecal.ground.decoding import decoding
from tumblecal.recordings.memory import require_size
from tumblecal.recordings.table import Reader, Source, Table


# A text is compressed by at most this factor.
_LARGEST_FACTOR, _PIECE = 200, 1 << 22
_FOLDERS: list[tempfile.TemporaryDirectory] = []


def _read(source: Source) -> list[Table]:
    from tumblecal.recordings.formats import tables_of

    folder = tempfile.TemporaryDirectory(prefix="tumblecal-")
    _FOLDERS.append(folder)  # the tables are read later; the folder is removed when the program ends
    path = Path(folder.name) / source.path.stem
    most, size = _LARGEST_FACTOR * source.path.stat().st_size, 0
    with decoding(source.path, "gzip file"), gzip.open(source.path) as packed, path.open("wb") as file:
        while piece := packed.read(_PIECE):
            size += file.write(piece)
            require_size(source.path, "its contents", size, most, "decompress it with gunzip")
    return tables_of(path, source.options, source.damage)[1]


READER = Reader("gzip", lambda path, head: head.startswith(b"\x1f\x8b"), _read)
