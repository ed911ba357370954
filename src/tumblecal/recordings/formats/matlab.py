"""MATLAB files: up to version 7 by scipy, 7.3 (HDF5) by h5py."""

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from tumblecal.ground.decoding import decoding, silenced
from tumblecal.recordings.formats.hdf5 import arrays_of
from tumblecal.recordings.table import Reader, Source, Table, tables_of_arrays


_BEGINS = b"MATLAB "
_HEADER_SIZE, _TAG_SIZE, _COMPRESSED = 128, 8, 15


def _read(source: Source) -> list[Table]:
    from scipy.io import loadmat

    with source.path.open("rb") as file:
        head = file.read(10)
    if head.startswith(b"MATLAB 7.3"):
        return tables_of_arrays(arrays_of(source.path))
    with decoding(source.path, "MATLAB file"), silenced():
        _check_elements(source.path)
        variables = loadmat(source.path, struct_as_record=True, squeeze_me=True)
    arrays: dict[str, np.ndarray] = {}
    for name, value in variables.items():
        if not name.startswith("__"):
            _collect(arrays, name, value)
    return tables_of_arrays(arrays)


def _check_elements(path: Path) -> None:
    """Check that the elements of a file of version 5 are contiguous to its end, and the checksums of compressed elements.

    scipy checks neither: it stops when the numbers are complete. https://www.mathworks.com/help/pdf_doc/matlab/matfile_format.pdf

    **Raises:** `ValueError` and `zlib.error`.
    """
    content = path.read_bytes()
    order, at = "<" if content[126:128] == b"IM" else ">", _HEADER_SIZE
    while at < len(content):
        kind, size = struct.unpack_from(f"{order}II", content, at)
        stop = at + _TAG_SIZE + size
        if stop > len(content):
            raise ValueError(f"the file ends within the element at byte {at}")
        if kind == _COMPRESSED:
            zlib.decompress(content[at + _TAG_SIZE : stop])
        at = stop


def _collect(arrays: dict[str, np.ndarray], name: str, value: Any) -> None:
    """The arrays of a variable; fields of a struct are `name/field`."""
    if isinstance(value, np.ndarray) and value.dtype.names and value.ndim == 0:
        value = value[()]
    if isinstance(value, np.void) and value.dtype.names:
        for field in value.dtype.names:
            _collect(arrays, f"{name}/{field}", value[field])
    elif isinstance(value, np.ndarray):
        arrays[name] = value


READER = Reader("MATLAB .mat", lambda path, head: head.startswith(_BEGINS), _read)
