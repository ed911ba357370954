"""Spreadsheets (.xlsx, .xls, .ods), by polars and fastexcel: a table for each sheet."""

import zipfile

import polars as pl

from tumblecal.capture.recordings.table import Reader, Source, SourceTable, library, of_arrays
from tumblecal.ground.decoding import decoding, silenced


def _read(source: Source) -> list[SourceTable]:
    library("fastexcel", source.path)
    with decoding(source.path, "spreadsheet"), silenced():
        if zipfile.is_zipfile(source.path) and (part := zipfile.ZipFile(source.path).testzip()):
            raise ValueError(f"{part}: its CRC-32 is wrong")
        sheets = pl.read_excel(source.path, sheet_id=0, raise_if_empty=False)
    tables = []
    for name, sheet in sheets.items():
        if len(sheet):
            tables.append(of_arrays(name, {column: sheet[column].to_numpy() for column in sheet.columns}, sheet=True))
    return tables


READER = Reader(
    "spreadsheet",
    lambda path, head: (
        path.suffix.lower() in (".xlsx", ".xlsm", ".ods", ".xls") and head[:4] in (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")
    ),
    _read,
)
