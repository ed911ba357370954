"""Samples as a table on disk, written in pieces: CSV, or Parquet by row groups; the file is complete or absent."""

from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import polars as pl

from tumblecal.capture.decoding.samples import Samples
from tumblecal.data.parquet import metadata_of, put_checksum
from tumblecal.ground.atomic import written_aside
from tumblecal.ground.plain_text import all_as_text
from tumblecal.ground.unwritable import unwritable


_ROW_GROUP = 1 << 18


def table_of(samples: Samples, rate_hz: float | None = None, first: int = 0) -> dict[str, np.ndarray]:
    """Samples as columns: time_s if the rate is known, ax_g .., gx_dps .., temperature_degc, counter, status.

    `first`: number of the first sample, for its time.
    """
    table = {"time_s": np.arange(first, first + len(samples)) / rate_hz} if rate_hz else {}
    table |= {f"a{axis}_g": samples.force[:, k] for k, axis in enumerate("xyz")}
    table |= {f"g{axis}_dps": samples.rate[:, k] for k, axis in enumerate("xyz")}
    others = {"temperature_degc": samples.temperature, "counter": samples.counter, "status": samples.status}
    return table | others


def known_columns(table: Mapping[str, np.ndarray]) -> set[str]:
    """The columns of a table of samples that the device sends; always includes the specific force."""
    return {name for name, values in table.items() if name in ("ax_g", "ay_g", "az_g") or np.isfinite(values).any()}


def write_frames(
    path: Path,
    frames: Iterator[pl.DataFrame],
    schema: pl.Schema,
    comments: Mapping[str, str] | None = None,
) -> None:
    """Write a table in pieces, .parquet (comments as metadata) or CSV by the name; the file is complete or absent.

    **Raises:** `InputError` if it cannot be written; exceptions of `frames` are passed on, and no file remains.
    """
    from polars.io.plugins import register_io_source

    with written_aside(path) as aside:
        try:
            rows = register_io_source(lambda *_: _made_ahead(frames), schema=schema)
            if path.suffix == ".parquet":
                metadata = metadata_of(comments or {})
                rows.sink_parquet(aside, row_group_size=_ROW_GROUP, compression="lz4", metadata=metadata)
                put_checksum(aside)
                return
            with aside.open("wb") as file:
                file.writelines(f"# {key}: {value}\n".encode() for key, value in (comments or {}).items())
                file.flush()
                rows.with_columns(all_as_text()).sink_csv(file)
        except (OSError, pl.exceptions.ComputeError) as error:
            raise unwritable(path, error) from error


def _made_ahead(frames: Iterator[pl.DataFrame]) -> Iterator[pl.DataFrame]:
    """Pieces of a table, the next of which is computed while the last is written."""
    with ThreadPoolExecutor(1) as maker:
        following = maker.submit(next, frames, None)
        while (frame := following.result()) is not None:
            following = maker.submit(next, frames, None)
            yield frame
