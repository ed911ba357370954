"""Spreadsheets (.xlsx, .xls, .ods), by polars and fastexcel: a table for each sheet.

The library reads a sheet as a grid from its first to its last cell. Blank cells far from the others, which have a format only,
are therefore removed first, and the grid is bounded.
"""

import re
import zipfile
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

import polars as pl

from tumblecal.capture.recordings.memory import require_size
from tumblecal.capture.recordings.table import Reader, Source, SourceTable, library, of_arrays
from tumblecal.ground.decoding import decoding, silenced


# Where the sheets of .xlsx are.
_SHEETS = "xl/worksheets/"
_EXPORT = "it is damaged, or most of its cells are empty: export the used columns and rows again"
# Bytes of a cell in memory.
_CELL_BYTES = 32
# Cells in the XML of a sheet of .xlsx, and those that have a format only.
_CELL = re.compile(rb'<c\s[^>]*?\br="([A-Z]+)(\d+)"')
_BLANK = re.compile(rb"<c\s[^>]*?(?:/>|></c>)")
# Rows of .ods with their contents; cells and rows may be repeated.
_ROW = re.compile(rb"<table:table-row([^>]*[^/])>(.*?)</table:table-row>", re.DOTALL)
_VALUE = re.compile(rb"<table:(?:covered-)?table-cell[^>]*office:value-type[^>]*>")
_REPEATED = re.compile(rb'repeated="(\d+)"')


def _read(source: Source) -> list[SourceTable]:
    library("fastexcel", source.path)
    with decoding(source.path, "spreadsheet"), silenced():
        content = _bounded(source.path) if zipfile.is_zipfile(source.path) else source.path
        sheets = pl.read_excel(content, sheet_id=0, raise_if_empty=False)
    tables = []
    for name, sheet in sheets.items():
        if len(sheet):
            tables.append(of_arrays(name, {column: sheet[column].to_numpy() for column in sheet.columns}, sheet=True))
    return tables


def _bounded(path: Path) -> Path | BytesIO:
    """The file, or its content without blank cells.

    **Raises:** `InputError` for a sheet whose grid is too large; `zipfile.BadZipFile` for a wrong checksum.
    """
    with zipfile.ZipFile(path) as archive:
        parts = {part: archive.read(part) for part in archive.namelist()}
    sheets = {part: _BLANK.sub(b"", xml) for part, xml in parts.items() if part.startswith(_SHEETS)}
    for part, xml in (parts | sheets).items():
        for rows, columns in _grids(part, xml):
            what = f"{part}: {rows} rows of {columns} columns up to the last cell"
            require_size(path, what, rows * columns * _CELL_BYTES, len(xml), _EXPORT)
    if all(parts[part] == xml for part, xml in sheets.items()):
        return path
    copied = BytesIO()
    with zipfile.ZipFile(copied, "w") as copy:
        for part, xml in (parts | sheets).items():
            copy.writestr(part, xml)
    return copied


def _grids(part: str, xml: bytes) -> Iterator[tuple[int, int]]:
    """Rows and columns of the grid of a sheet."""
    if part.startswith(_SHEETS):
        rows = columns = 0
        for found in _CELL.finditer(xml):
            columns, rows = max(columns, _column(found[1])), max(rows, int(found[2]))
        yield rows, columns
    elif part == "content.xml":
        for row in _ROW.finditer(xml):
            values = sum(_repeats(cell[0]) for cell in _VALUE.finditer(row[2]))
            yield _repeats(row[1]) if values else 0, values


def _column(letters: bytes) -> int:
    """Number of a column from its letters: A is 1, XFD is 16384."""
    number = 0
    for letter in letters:
        number = 26 * number + letter - ord("A") + 1
    return number


def _repeats(tag: bytes) -> int:
    found = _REPEATED.search(tag)
    return int(found[1]) if found else 1


READER = Reader(
    "spreadsheet",
    lambda path, head: (
        path.suffix.lower() in (".xlsx", ".xlsm", ".ods", ".xls") and head[:4] in (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")
    ),
    _read,
)
