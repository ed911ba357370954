"""Spreadsheets (.xlsx, .xls, .ods), by polars and fastexcel: a table a sheet."""

from pathlib import Path

from tumblecal.capture.recordings.options import Asked
from tumblecal.capture.recordings.table import Reader, SourceTable, damaged, library, of_arrays


def _read(path: Path, asked: Asked) -> list[SourceTable]:
    import polars as pl

    library("fastexcel", path)
    try:
        sheets = pl.read_excel(path, sheet_id=0, raise_if_empty=False)
    except Exception as error:  # the library raises what it likes on damaged bytes
        raise damaged(path, "spreadsheet", error) from error
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
