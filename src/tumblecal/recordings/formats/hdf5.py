"""HDF5 files: datasets, or tables with named fields, by h5py. Nothing outside the file is read."""

from pathlib import Path
from typing import Any

import numpy as np

from tumblecal.ground.decoding import decoding, silenced
from tumblecal.ground.errors import InputError
from tumblecal.recordings.memory import require_size
from tumblecal.recordings.table import Reader, library, tables_of_arrays


_EXPORT = "it is damaged, or was not written to its end: export its values again"


def arrays_of(path: Path) -> dict[str, np.ndarray]:
    """The datasets of a file by path; fields of a table are `table/field`. External links are ignored.

    **Raises:** `InputError` for a damaged file, for datasets whose values are in other files, for values that are not in the
    file, or without h5py.
    """
    h5py: Any = library("h5py", path)
    arrays: dict[str, np.ndarray] = {}

    def collect(name: str, item: Any) -> None:
        with_numbers = isinstance(item, h5py.Dataset) and (item.dtype.names or item.dtype.kind in "iufb")
        # Objects of MATLAB are references to values in the group #subsystem#.
        if not with_numbers or item.ndim not in (1, 2) or name.startswith("#") or "MATLAB_object_decode" in item.attrs:
            return
        if item.external or item.is_virtual:
            raise InputError(
                f"{path}: the values of {name} are in another file, which is not read; copy them into one file (h5repack)"
            )
        # Chunks that were never written have no size in the file, but in memory.
        held = item.id.get_num_chunks() * int(np.prod(item.chunks)) if item.chunks else item.size
        require_size(path, f"{name}: {item.size} values", item.nbytes, held * item.dtype.itemsize, _EXPORT)
        values = item[()]
        arrays.update({f"{name}/{field}": values[field] for field in item.dtype.names or ()} or {name: values})

    with decoding(path, "HDF5 file"), silenced(), h5py.File(path, "r") as file:
        file.visititems(collect)
    return arrays


READER = Reader(
    "HDF5",
    lambda path, head: head.startswith(b"\x89HDF\r\n\x1a\n"),
    lambda source: tables_of_arrays(arrays_of(source.path)),
)
