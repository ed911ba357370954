"""HDF5 files: datasets, or tables with named fields, by h5py."""

from pathlib import Path
from typing import Any

import numpy as np

from tumblecal.capture.recordings.table import Reader, library, tables_of_arrays
from tumblecal.ground.decoding import decoding, silenced


def arrays_of(path: Path) -> dict[str, np.ndarray]:
    """The datasets of a file by path; fields of a table are `table/field`.

    **Raises:** `InputError` for a damaged file, or without h5py.
    """
    h5py: Any = library("h5py", path)
    arrays: dict[str, np.ndarray] = {}

    def collect(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or item.ndim not in (1, 2) or name.startswith("#"):
            return
        if item.dtype.names:
            arrays.update({f"{name}/{field}": item[field] for field in item.dtype.names})
        elif item.dtype.kind in "iufb":
            arrays[name] = item[()]

    with decoding(path, "HDF5 file"), silenced(), h5py.File(path, "r") as file:
        file.visititems(collect)
    return arrays


READER = Reader(
    "HDF5",
    lambda path, head: head.startswith(b"\x89HDF\r\n\x1a\n"),
    lambda source: tables_of_arrays(arrays_of(source.path)),
)
