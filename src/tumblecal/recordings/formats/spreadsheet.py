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

from tumblecal.ground.decoding import decoding, silenced
from tumblecal.recordings.memory import require_size
from tumblecal.recordings.table import Reader, Source, Table, library, of_arrays


# The sheets of .xls; where those of .xlsx are.
_XLS = "sheets"
_SHEETS = "xl/worksheets/"
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
    library("fastexcel", source.path)
    with decoding(source.path, "spreadsheet"), silenced():
        zipped = zipfile.is_zipfile(source.path)
        content = _bounded(source.path) if zipped else source.path
        if not zipped:
            _require_grid(source.path, _XLS, source.path.read_bytes())
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
        _require_grid(path, part, xml)
    if all(parts[part] == xml for part, xml in sheets.items()):
        return path
    copied = BytesIO()
    with zipfile.ZipFile(copied, "w") as copy:
        for part, xml in (parts | sheets).items():
            copy.writestr(part, xml)
    return copied


def _require_grid(path: Path, part: str, content: bytes) -> None:
    for rows, columns in _grids(part, content):
        what = f"{part}: {rows} rows of {columns} columns up to the last cell"
        require_size(path, what, rows * columns * _CELL_BYTES, len(content), _EXPORT)


def _grids(part: str, xml: bytes) -> Iterator[tuple[int, int]]:
    """Rows and columns of the grid of a sheet; of .xls, whose sheets are in one stream, of the largest."""
    if part == _XLS:
        cells = [(int.from_bytes(found[1], "little"), found[2][0]) for found in _XLS_CELL.finditer(xml)]
        yield max((row for row, _ in cells), default=-1) + 1, max((column for _, column in cells), default=-1) + 1
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
