"""Recordings whose cells or values are not in the file: one line, before the memory is allocated. Nothing else is read."""

import zipfile
from pathlib import Path

import numpy as np
import pytest


HEADER = ("time_s", "ax_g", "ay_g", "az_g")


def book(path: Path, stray) -> Path:
    xlsxwriter = pytest.importorskip("xlsxwriter")
    with xlsxwriter.Workbook(str(path)) as workbook:
        sheet = workbook.add_worksheet("log")
        for column, name in enumerate(HEADER):
            sheet.write(0, column, name)
        for row in range(2000):
            for column, value in enumerate((row / 100, 0.001 * (row % 5), 0.002, 1.0)):
                sheet.write_number(row + 1, column, value)
        stray(sheet, workbook.add_format({"bold": True}))
    return path


@pytest.mark.parametrize(
    ("row", "column", "value"), [(60_000, 2_000, "x"), pytest.param(1_000_000, 16_383, None, marks=pytest.mark.long)]
)
def test_a_cell_far_from_the_others_is_one_line(
    tumblecal, tmp_path: Path, row: int, column: int, value: str | None
) -> None:
    """A value, or a blank cell that has a format."""
    path = book(tmp_path / "log.xlsx", lambda sheet, bold: sheet.write(row, column, value, bold))
    outcome = tumblecal("import", path)
    assert outcome.code == 2 and len(outcome.lines) == 1
    assert f"{row + 1} rows of {column + 1} columns up to the last cell need " in outcome.lines[0]


def test_repeated_cells_of_an_open_document_are_one_line(tumblecal, tmp_path: Path) -> None:
    cell = '<table:table-cell table:number-columns-repeated="16384" office:value-type="float" office:value="1"/>'
    with zipfile.ZipFile(tmp_path / "log.ods", "w") as archive:
        archive.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        archive.writestr(
            "content.xml", f'<t><table:table-row table:number-rows-repeated="1048576">{cell}</table:table-row></t>'
        )
    outcome = tumblecal("import", tmp_path / "log.ods", "--out", tmp_path / "out.csv")
    assert outcome.code == 2 and "1048576 rows of 16384 columns" in outcome.lines[0]


@pytest.mark.parametrize("kind", ["external storage", "virtual", "external link"])
def test_an_hdf5_file_reads_no_other_file(tumblecal, tmp_path: Path, kind: str) -> None:
    h5py = pytest.importorskip("h5py")
    (tmp_path / "secret").write_bytes(np.full(100, 0.6).tobytes())
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["ax"] = np.full(100, 0.6)
    with h5py.File(tmp_path / "log.h5", "w") as file:
        if kind == "external storage":
            file.create_dataset("ax", shape=(100,), dtype="f8", external=[(str(tmp_path / "secret"), 0, 800)])
        elif kind == "virtual":
            layout = h5py.VirtualLayout((100,), dtype="f8")
            layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "ax", shape=(100,))
            file.create_virtual_dataset("ax", layout)
        else:
            file["ax"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "ax")
        file["ay"], file["az"] = np.zeros(100), np.full(100, 0.8)
    outcome = tumblecal("import", tmp_path / "log.h5", "--rate", "100", "--out", tmp_path / "out.csv")
    words = (
        "the columns 'ay, az'" if kind == "external link" else "the values of ax are in another file, which is not read"
    )
    assert outcome.code == 2 and words in outcome.lines[0] and not (tmp_path / "out.csv").exists()
