"""Spreadsheets (.xlsx, .xls, .ods), by polars and fastexcel: a table for each sheet."""

import zipfile
from pathlib import Path

import polars as pl

from tumblecal.capture.recordings.damage import Damage
from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.capture.recordings.table import Reader, SourceTable, library, of_arrays
from tumblecal.ground.decoding import decoding, silenced


def _read(path: Path, options: RecordingOptions, damage: Damage) -> list[SourceTable]:
    library("fastexcel", path)
    with decoding(path, "spreadsheet"), silenced():
        if zipfile.is_zipfile(path) and (part := zipfile.ZipFile(path).testzip()):
            raise ValueError(f"{part}: its CRC-32 is wrong")
        sheets = pl.read_excel(path, sheet_id=0, raise_if_empty=False)
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
