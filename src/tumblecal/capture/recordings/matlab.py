"""MATLAB files: up to version 7 by scipy, 7.3 (HDF5) by h5py."""

from pathlib import Path
from typing import Any

import numpy as np

from tumblecal.capture.recordings.hdf5 import arrays_of
from tumblecal.capture.recordings.options import Asked
from tumblecal.capture.recordings.table import Reader, SourceTable, damaged, tables_of_arrays


_BEGINS = b"MATLAB "


def _read(path: Path, asked: Asked) -> list[SourceTable]:
    from scipy.io import loadmat

    with path.open("rb") as file:
        head = file.read(10)
    if head.startswith(b"MATLAB 7.3"):
        return tables_of_arrays(arrays_of(path))
    try:
        variables = loadmat(path, struct_as_record=True, squeeze_me=True)
    except Exception as error:  # the library's own readers raise what they like on damaged bytes
        raise damaged(path, "MATLAB file", error) from error
    arrays: dict[str, np.ndarray] = {}
    for name, value in variables.items():
        if not name.startswith("__"):
            _collect(arrays, name, value)
    return tables_of_arrays(arrays)


def _collect(arrays: dict[str, np.ndarray], name: str, value: Any) -> None:
    """The arrays of a variable; the fields of a struct as `name/field`."""
    if isinstance(value, np.ndarray) and value.dtype.names and value.ndim == 0:
        for field in value.dtype.names:
            _collect(arrays, f"{name}/{field}", value[()][field])
    elif isinstance(value, np.void) and value.dtype.names:
        for field in value.dtype.names:
            _collect(arrays, f"{name}/{field}", value[field])
    elif isinstance(value, np.ndarray):
        arrays[name] = value


READER = Reader("MATLAB .mat", lambda path, head: head.startswith(_BEGINS), _read)
