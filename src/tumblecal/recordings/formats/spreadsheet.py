"""Spreadsheets (.xlsx, .xls, .ods), by polars and fastexcel: a table for each sheet.

The library reads a sheet as a grid from its first to its last cell, so the grid is bounded first.
"""

import re
import zipfile
from collections.abc import Iterator

import polars as pl

from tumblecal.ground.decoding import decoding, silenced
from tumblecal.recordings.memory import require_size
from tumblecal.recordings.table import Reader, Source, Table, library, of_arrays


_EXPORT = "it is damaged, or most of its cells are empty: export the used columns and rows again"
# Bytes of a cell in memory: in the grid of the library and in the columns made from it.
_CELL_BYTES = 80
# Cells in the XML of a sheet of .xlsx.
_CELL = re.compile(rb'<c\s[^>]*?\br="([A-Z]+)(\d+)"')
# Rows of .ods with their contents; cells and rows may be repeated.
_ROW = re.compile(rb"<table:table-row([^>]*[^/])>(.*?)</table:table-row>", re.DOTALL)
_VALUE = re.compile(rb"<table:(?:covered-)?table-cell[^>]*office:value-type[^>]*>")
_REPEATED = re.compile(rb'repeated="(\d+)"')


def _read(source: Source) -> list[Table]:
    path = source.path
    library("fastexcel", path)
    with decoding(path, "spreadsheet"), silenced():
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                for part in archive.namelist():
                    for rows, columns in _grids(part, content := archive.read(part)):
                        what = f"{part}: {rows} rows of {columns} columns up to the last cell"
                        require_size(path, what, rows * columns * _CELL_BYTES, len(content), _EXPORT)
        sheets = pl.read_excel(path, sheet_id=0, raise_if_empty=False)
    return [
        of_arrays(name, {column: sheet[column].to_numpy() for column in sheet.columns}, sheet=True)
        for name, sheet in sheets.items()
        if len(sheet)
    ]


def _grids(part: str, content: bytes) -> Iterator[tuple[int, int]]:
    """Rows and columns of the grid of a sheet of .xlsx, and of each row of .ods."""
    if part == "content.xml":
        for tag, cells in _ROW.findall(content):
            yield _repeats(tag), sum(map(_repeats, _VALUE.findall(cells)))
    elif part.startswith("xl/worksheets/"):
        cells = _CELL.findall(content) or [(b"A", b"1")]
        letters = max((letters for letters, _ in cells), key=lambda letters: (len(letters), letters))
        # A is 1, XFD is 16384.
        columns = sum((letter - ord("@")) * 26**power for power, letter in enumerate(reversed(letters)))
        yield max(int(row) for _, row in cells), columns


def _repeats(tag: bytes) -> int:
    found = _REPEATED.search(tag)
    return int(found[1]) if found else 1


_SUFFIXES, _MAGICS = (".xlsx", ".xlsm", ".ods", ".xls"), (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")
READER = Reader("spreadsheet", lambda path, head: path.suffix.lower() in _SUFFIXES and head.startswith(_MAGICS), _read)
