"""MATLAB files: up to version 7 by scipy, 7.3 (HDF5) by h5py. Objects of MATLAB, such as tables, are ignored."""

import struct
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from tumblecal.ground.decoding import decoding, silenced
from tumblecal.ground.errors import InputError
from tumblecal.recordings.formats.hdf5 import arrays_of
from tumblecal.recordings.table import Reader, Source, Table, tables_of_arrays


_HEADER_SIZE, _TAG_SIZE, _COMPRESSED = 128, 8, 15


def _read(source: Source) -> list[Table]:
    from scipy.io import loadmat

    content = source.path.read_bytes()
    if content.startswith(b"MATLAB 7.3"):
        arrays = arrays_of(source.path)
    else:
        with decoding(source.path, "MATLAB file"), silenced():
            _check_elements(content)
            variables = loadmat(source.path, squeeze_me=True)
        arrays = {
            path: array for name in variables if name[:2] != "__" for path, array in _arrays(name, variables[name])
        }
    if tables := tables_of_arrays(arrays):
        return tables
    raise InputError(
        f"{source.path}: no arrays; tables, timetables and other objects of MATLAB are not read: write them with writetable or "
        "writetimetable, or save table2struct(T, ToScalar=true)"
    )


def _check_elements(content: bytes) -> None:
    """Check that the elements of a file of version 5 are contiguous to its end, and the checksums of compressed elements.

    scipy checks neither: it stops when the numbers are complete. https://www.mathworks.com/help/pdf_doc/matlab/matfile_format.pdf

    **Raises:** `ValueError` and `zlib.error`.
    """
    order, at = "<" if content[126:128] == b"IM" else ">", _HEADER_SIZE
    while at < len(content):
        kind, size = struct.unpack_from(f"{order}II", content, at)
        element = content[at + _TAG_SIZE :][:size]
        if len(element) < size:
            raise ValueError(f"the file ends within the element at byte {at}")
        if kind == _COMPRESSED:
            zlib.decompress(element)
        at += _TAG_SIZE + size


def _arrays(name: str, value: Any) -> Iterator[tuple[str, np.ndarray]]:
    """The arrays of a variable; fields of a struct are `name/field`."""
    if isinstance(value, np.ndarray | np.void) and value.dtype.names and not value.shape:
        for field in value.dtype.names:
            yield from _arrays(f"{name}/{field}", value[field][()])
    elif isinstance(value, np.ndarray):
        yield name, value


READER = Reader("MATLAB .mat", lambda path, head: head.startswith(b"MATLAB "), _read)
