"""Spreadsheets (.xlsx, .xls, .ods), by polars and fastexcel: a table for each sheet.

The library reads a sheet as a grid from its first to its last cell. Blank cells far from the others, which have a format only,
are therefore removed first, and the grid is bounded.
"""

import re
import zipfile
from functools import reduce
from io import BytesIO

import polars as pl

from tumblecal.ground.decoding import decoding, silenced
from tumblecal.recordings.memory import require_size
from tumblecal.recordings.table import Reader, Source, Table, library, of_arrays


# The part of the sheets of .xls; of .ods; the folder of those of .xlsx.
_XLS, _ODS, _XLSX = "sheets", "content.xml", "xl/worksheets/"
_EXPORT = "it is damaged, or most of its cells are empty: export the used columns and rows again"
# Bytes of a cell in memory: in the grid of the library and in the columns made from it.
_CELL_BYTES = 80
# Cells in the XML of a sheet of .xlsx, and those that have a format only.
_CELL = re.compile(rb'<c\s[^>]*?\br="([A-Z]+)(\d+)"')
_BLANK = re.compile(rb"<c\s[^>]*?(?:/>|></c>)")
# Rows of .ods with their contents; cells and rows may be repeated.
_ROW = re.compile(rb"<table:table-row([^>]*[^/])>(.*?)</table:table-row>", re.DOTALL)
_VALUE = re.compile(rb"<table:(?:covered-)?table-cell[^>]*office:value-type[^>]*>")
_REPEATED = re.compile(rb'repeated="(\d+)"')
# Records of .xls with a number or a text: row and column (at most 255), little-endian.
_XLS_CELL = re.compile(rb"(?:\x03\x02\x0e\x00|\xfd\x00\x0a\x00|\x7e\x02\x0a\x00)(..)(.)\x00", re.DOTALL)


def _read(source: Source) -> list[Table]:
    path = source.path
    library("fastexcel", path)
    with decoding(path, "spreadsheet"), silenced():
        parts = {_XLS: path.read_bytes()}
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                parts = {part: archive.read(part) for part in archive.namelist()}
        used = {part: _BLANK.sub(b"", xml) if part.startswith(_XLSX) else xml for part, xml in parts.items()}
        for part, content in used.items():
            for rows, columns in _grids(part, content):
                what = f"{part}: {rows} rows of {columns} columns up to the last cell"
                require_size(path, what, rows * columns * _CELL_BYTES, len(content), _EXPORT)
        sheets = pl.read_excel(path if used == parts else _archive(used), sheet_id=0, raise_if_empty=False)
    return [
        of_arrays(name, {column: sheet[column].to_numpy() for column in sheet.columns}, sheet=True)
        for name, sheet in sheets.items()
        if len(sheet)
    ]


def _archive(parts: dict[str, bytes]) -> BytesIO:
    copied = BytesIO()
    with zipfile.ZipFile(copied, "w") as copy:
        for part, content in parts.items():
            copy.writestr(part, content)
    return copied


def _grids(part: str, content: bytes) -> list[tuple[int, int]]:
    """Rows and columns of the grids of a part; of .xls, whose sheets are in one stream, of the largest."""
    if part == _ODS:
        rows = [(_repeats(row[1]), sum(map(_repeats, _VALUE.findall(row[2])))) for row in _ROW.finditer(content)]
        return [row for row in rows if row[1]]
    cells = [(0, 0)]
    if part == _XLS:
        cells += [(int.from_bytes(row, "little") + 1, column[0] + 1) for row, column in _XLS_CELL.findall(content)]
    elif part.startswith(_XLSX):
        cells += [(int(row), _number(letters)) for letters, row in _CELL.findall(content)]
    rows, columns = map(max, zip(*cells, strict=True))
    return [(rows, columns)]


def _number(letters: bytes) -> int:
    """Number of a column from its letters: A is 1, XFD is 16384."""
    return reduce(lambda number, letter: 26 * number + letter - ord("@"), letters, 0)


def _repeats(tag: bytes) -> int:
    found = _REPEATED.search(tag)
    return int(found[1]) if found else 1


_SUFFIXES, _MAGICS = (".xlsx", ".xlsm", ".ods", ".xls"), (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")
READER = Reader("spreadsheet", lambda path, head: path.suffix.lower() in _SUFFIXES and head.startswith(_MAGICS), _read)
