"""Byte logs of the serial protocols, as `tumblecal decode` reads them."""

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from weakref import finalize

import polars as pl

from tumblecal.capture.decoding.byte_file import decode_file
from tumblecal.capture.decoding.samples import Stated
from tumblecal.capture.decoding.sniff import ENOUGH, guesses
from tumblecal.capture.log import MAGIC
from tumblecal.capture.protocols import protocols
from tumblecal.ground.errors import InputError
from tumblecal.recordings.formats.parquet import READER as PARQUET
from tumblecal.recordings.table import Reader, Source, Table


_COLUMNS = ("time_s", "ax_g", "ay_g", "az_g", "gx_dps", "gy_dps", "gz_dps", "temperature_degc")
# `text.py` reads text lines of any layout, except lines with the checksums of a protocol.
_TEXT_OF_PROTOCOLS = b"$"


def _recognised(path: Path, head: bytes) -> bool:
    if head.startswith(MAGIC):
        return True
    if b"\x00" not in head and not head.startswith(_TEXT_OF_PROTOCOLS):
        return False
    best = guesses(head)[0]
    return best.explained >= ENOUGH and best.frames >= 3 and protocols()[best.name].checked


def _read(source: Source) -> list[Table]:
    """The table of a log, which is decoded into a temporary file."""
    folder = Path(tempfile.mkdtemp(prefix="tumblecal-"))
    decoded, stated = folder / "samples.parquet", Stated(source.options.range_g, source.options.rate)

    def pieces(wanted: Sequence[str]) -> Iterator[pl.DataFrame]:
        (table,) = PARQUET.read(source._replace(path=decoded))
        there = [name for name in wanted if name in table.columns]
        lacking = [pl.lit(None, pl.Float64).alias(name) for name in wanted if name not in there]
        for piece in table.pieces([*there, "status"]):
            yield piece.filter(pl.col("status") == 0).with_columns(lacking).select(wanted)

    # The folder is removed when the table, or the program, ends.
    finalize(pieces, shutil.rmtree, folder, ignore_errors=True)
    contents = decode_file(source.path, source.options.protocol, out=decoded, stated=stated)
    if not contents.good:
        refused = next((event.content["text"] for event in contents.events if event.kind == "refused"), "no samples")
        raise InputError(f"{source.path}: {contents.statistics() if contents.samples else refused}")
    for words in contents.faults():
        source.damage.report(words)
    columns = _COLUMNS if contents.rate_hz else _COLUMNS[1:]
    words = "; ".join(filter(None, [f"{contents.protocol.title}, {contents.samples} samples", contents.losses()]))
    return [Table("", columns, pieces, contents.samples, words=words, row_word="sample")]


READER = Reader("byte log of a serial protocol", _recognised, _read, rank=1)
