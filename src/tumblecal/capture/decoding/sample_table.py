"""Samples as a table on disk, written in pieces: CSV, or Parquet by row groups; the file is complete or absent."""

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

import numpy as np
import polars as pl

from tumblecal.capture.decoding.samples import Samples, blank
from tumblecal.data.parquet import metadata_of, put_checksum
from tumblecal.ground.atomic import written_aside
from tumblecal.ground.formula_cells import all_as_text
from tumblecal.ground.unwritable import unwritable


_ROW_GROUP = 1 << 18
_Piece = TypeVar("_Piece")


def columns_of(samples: Samples) -> frozenset[str]:
    """The parts of samples that are known and become columns; always includes "force"."""
    known = {"force"}
    if np.isfinite(samples.rate).any():
        known.add("rate")
    if np.isfinite(samples.temperature).any():
        known.add("temperature")
    return frozenset(known)


def write_pieces(path: Path, pieces: Iterator[Samples], columns: frozenset[str], rate_hz: float | None) -> None:
    """Write samples as .csv or .parquet: ax_g .., gx_dps .., temperature_degc, counter, status, time_s if known.

    **Raises:** `InputError` if it cannot be written; exceptions of `pieces` are passed on, and no file remains.
    """

    def frames() -> Iterator[pl.DataFrame]:
        first = 0
        for samples in pieces:
            yield pl.DataFrame(table_of(samples, columns, rate_hz, first))
            first += len(samples)

    write_frames(path, frames(), pl.DataFrame(table_of(blank(0), columns, rate_hz, 0)).schema)


def write_frames(
    path: Path,
    frames: Iterator[pl.DataFrame],
    schema: pl.Schema,
    comments: Mapping[str, str] | None = None,
    lines: Sequence[str] | None = None,
) -> None:
    """Write a table in pieces, .parquet (comments as metadata) or CSV by the name; the file is complete or absent.

    **Arguments:**

    - `lines`: the comment lines before a CSV table, if they are not `# key: value`.

    **Raises:** `InputError` if it cannot be written; exceptions of `frames` are passed on, and no file remains.
    """
    from polars.io.plugins import register_io_source

    lines = [f"# {key}: {value}" for key, value in (comments or {}).items()] if lines is None else lines
    with written_aside(path) as aside:
        try:
            rows = register_io_source(lambda *_: _made_ahead(frames), schema=schema)
            if path.suffix == ".parquet":
                metadata = metadata_of(comments or {})
                rows.sink_parquet(aside, row_group_size=_ROW_GROUP, compression="lz4", metadata=metadata)
                put_checksum(aside)
            else:
                with aside.open("wb") as file:
                    file.writelines(f"{line}\n".encode() for line in lines)
                    file.flush()
                    rows.with_columns(all_as_text()).sink_csv(file)
        except (OSError, pl.exceptions.ComputeError) as error:
            raise unwritable(path, error) from error


def _made_ahead(pieces: Iterator[_Piece]) -> Iterator[_Piece]:
    """Pieces, the next of which is computed while the last is written."""
    with ThreadPoolExecutor(1) as maker:
        following = maker.submit(next, pieces, None)
        while (piece := following.result()) is not None:
            following = maker.submit(next, pieces, None)
            yield piece


def table_of(
    samples: Samples, columns: frozenset[str], rate_hz: float | None = None, first: int = 0
) -> dict[str, np.ndarray]:
    """Samples as columns with the names that `write_pieces` states; `first`: number of the first sample, for its time."""
    table: dict[str, np.ndarray] = {}
    if rate_hz:
        table["time_s"] = np.arange(first, first + len(samples)) / rate_hz
    table |= {f"a{axis}_g": samples.force[:, k] for k, axis in enumerate("xyz")}
    if "rate" in columns:
        table |= {f"g{axis}_dps": samples.rate[:, k] for k, axis in enumerate("xyz")}
    if "temperature" in columns:
        table["temperature_degc"] = samples.temperature
    return table | {"counter": samples.counter, "status": samples.status}
