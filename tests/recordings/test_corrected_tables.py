"""`apply` to tables as spreadsheets and people leave them: every separator, blank lines, comments, columns twice."""

import re

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tumblecal.data.calibration import Calibration, write_calibration
from tumblecal.data.raw import read_raw
from tumblecal.ground.errors import InputError


MATRIX, BIAS = np.diag([1.01, 0.99, 1.02]), np.array([0.02, -0.03, 0.05])


@pytest.fixture
def applied(tumblecal, tmp_path):
    """What `apply` says of a text, and what it writes of it."""
    write_calibration(tmp_path / "cal.json", Calibration(MATRIX, BIAS, np.zeros((12, 12))))

    def apply(text: str, name="log.csv"):
        (tmp_path / name).write_bytes(text.encode())
        outcome = tumblecal("apply", tmp_path / "cal.json", tmp_path / name, "--out", tmp_path / "out.csv")
        out = tmp_path / "out.csv"
        return outcome, out.read_text().splitlines() if out.exists() else []

    return apply


OWN = ["--columns", "ax_g=AccX,ay_g=AccY,az_g=AccZ"]
# Tables with @ before each reading, their options, and the other columns of the corrected CSV.
TABLES = {
    "semicolons, decimal commas, padded comments, returns": (
        "# serial_number: U17;;;;;;\r\n# note: \xfcber;;;;;;\r\n"
        "position;alpha_deg;beta_deg;ax_g;ay_g;az_g;operator\r\n"
        "p1;0;0;@0,1;@0,2;@0,97;Ann\r\n# in the middle;;\r\n\r\np2;90,5;30;@-1e-1;@1;@0,5;007\r\n;;;;;;\r\n",
        [],
        ["position,alpha_deg,beta_deg,operator", "p1,0,0,Ann", "p2,90.5,30,007"],
    ),
    "counters beyond float64": (
        "ns,AccX,AccY,AccZ\n1730000000123456789,@0.1,@0.2,@1\n1730000000133456789,@0.1,@0.25,@1\n",
        OWN,
        ["ns", "1730000000123456789", "1730000000133456789"],
    ),
    "tabs": (
        "AccX\tt\tAccY\tAccZ\n@0.1\t007\t@0.2\t@1\n@0.1\t1.50\t@0.25\t@1\n", OWN, ["t", "007", "1.50"]
    ),
    "a mark of UTF-8, numpy's header": (
        "\ufeff# ax_g,ay_g,az_g,x\n@0.1,@0.2,@1,5\n@0.1,@0.3,@1,5", [], ["x", "5", "5"]
    ),
    "quotation marks": (
        '"# a: b, c",,,,\n"id","ax_g","ay_g","az_g",note\n"1,5","@0.1",@0.2, @0.3 ,"5"" pipe"\n2,@1,"@2",@3,"x,y"\n',
        [],
        ["id,note", '"1,5","5"" pipe"', '2,"x,y"'],
    ),
    "cells over several lines": (
        'id,ax_g,ay_g,az_g\n"a\r\n, b",@0.1,@0.2,@0.3\nc,@1,@2,@3\r"d\n\n e",@3,@2,@1\n',
        [],
        ["id", '"a\n, b"', "c", '"d\n\n e"'],
    ),
    "Latin-1 and a preamble": (
        "Logger;7\nt;AccX;AccY;AccZ;\xb0C\n1;@0;@0;@1;20\n2;@0;@1;@0;20\n", OWN, ["t,\xb0C", "1,20", "2,20"]
    ),
    "decimal commas within quotation marks": (
        'AccX,AccY,AccZ,n\n"@0,125","@0,2","@1,5","1,5"\n"@0,25","@0,5","@0,25",7\n',
        [*OWN, "--decimal", "comma"],
        ["n", "1.5", "7"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_a_csv_with_all_columns_and_corrected_readings(tumblecal, tmp_path, small_pieces, name):
    """From every separator, decimal mark and end of lines; the readings are the formula."""
    text, options, others = TABLES[name]
    encoding = "latin-1" if "Latin-1" in name else "utf-8"
    write_calibration(tmp_path / "cal.json", Calibration(MATRIX, BIAS, np.zeros((12, 12)), serial_number="U17"))
    (tmp_path / "log.txt").write_bytes(text.replace("@", "").encode(encoding))
    outcome = tumblecal("apply", tmp_path / "cal.json", tmp_path / "log.txt", *options)
    assert outcome.code == 0, outcome.lines
    got = pl.read_csv(tmp_path / "log_corrected.csv", comment_prefix="#", infer_schema=False)
    unit, size = ("mg", 1e3) if "_mg" in text else ("g", 1.0)
    readings = [f"a{axis}_{unit}" for axis in "xyz"]
    assert got.drop(readings).write_csv() == "".join(f"{line}\n" for line in others)
    number = r"@([-+0-9,e]+)" if "decimal commas" in name else r"@([-+0-9.e]+)"
    before = np.array([float(cell.replace(",", ".")) for cell in re.findall(number, text)]).reshape(-1, 3) / size
    after = got.select(readings).cast(pl.Float64).to_numpy() / size
    np.testing.assert_allclose(after, (before - BIAS) @ MATRIX.T, rtol=1e-14, atol=1e-16)
    lines = (tmp_path / "log_corrected.csv").read_text().splitlines()
    assert f"# corrected_by: {tmp_path / 'cal.json'}" in lines and (
        "U17" not in text or lines[0] == "# serial_number: U17"
    )


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_parquet_keeps_its_columns_and_comments(tumblecal, tmp_path, suffix):
    write_calibration(tmp_path / "cal.json", Calibration(MATRIX, BIAS, np.zeros((12, 12)), serial_number="U17"))
    frame = pl.DataFrame(
        {"pos": ["a", "b"], "alpha": [0, 90], "AccX": [0.1, 0.2], "AccY": [0.3, 0.4], "AccZ": [0.9, 1.0]}
    )
    frame = frame.with_columns(t=pl.Series([5.5, 6.5], dtype=pl.Float32))
    frame.write_parquet(tmp_path / "log.parquet", metadata={"serial_number": "U17", "rig": "b"})
    out = tmp_path / f"out.{suffix}"
    assert tumblecal("apply", tmp_path / "cal.json", tmp_path / "log.parquet", *OWN, "--out", out).code == 0
    force = (frame.select("AccX", "AccY", "AccZ").to_numpy() - BIAS) @ MATRIX.T
    if suffix == "csv":
        assert out.read_text().startswith("# rig: b\n# serial_number: U17\n# corrected_by: ")
        got = pl.read_csv(out, comment_prefix="#")
    else:
        got = pl.read_parquet(out)
        assert pl.read_parquet_metadata(out).items() >= {"serial_number": "U17", "rig": "b"}.items()
        assert got["t"].dtype == pl.Float32 and got["alpha"].dtype == pl.Int64
    assert (
        got.columns == ["pos", "alpha", "ax_g", "ay_g", "az_g", "t"]
        and got["pos"].to_list() == ["a", "b"]
        and got["t"].to_list() == [5.5, 6.5]
    )
    np.testing.assert_allclose(got.to_numpy()[:, 2:5].astype(float), force, rtol=1e-14)
    with pytest.raises(InputError, match="corrected already"):
        read_raw(out)


NO_ROWS = {
    "0,0": "2 cells, but the header has 4; complete the row or remove it",
    "note": "1 cell, but the header has 4; complete the row or remove it",
    "ax_g,ay_g,az_g,id": "the names of the columns again; remove the line",
    "g,g,g,-": "a line of units, not a row; write # before it: the names of the columns state the units",
    "0,0,,": "column az_g: the cell is empty; write a number, or remove the row or the whole column",
    "0,0,1,7,8": "5 cells, but the header has 4; remove the row",
    "0,zero,1,7": "column ay_g: 'zero' is not a number",
}
FAULTS = {
    "\n".join(["# a: b", "ax_g,ay_g,az_g,id", *["0,0,1,7"] * 9, "", row, "0,0,1,7"]): ("log.csv:line 13", words)
    for row, words in NO_ROWS.items()
}
FAULTS |= {
    "ax_g;ay_g;az_g\n0,1;0,2;1.000": ("line 2, column az_g: '1.000' is not a number", "one decimal mark"),
    "ax_g;ay_g;az_g\n" + "0.1;0;1\n" * 2000 + "0.1;0;1,5": ("line 2002, column az_g", "use a decimal point"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "words"), FAULTS.items(), ids=[" ".join(words) for words in FAULTS.values()])
def test_a_line_that_is_no_row_is_told_and_nothing_is_written(applied, small_pieces, tmp_path, text, words):
    outcome, _ = applied(f"{text}\n")
    assert outcome.code == 2 and len(outcome.lines) == 1
    assert all(part in outcome.lines[0] for part in words)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cal.json", "log.csv"]


LINES = st.lists(st.sampled_from(["0,0,1", "", " ", ",,", " ,,", "# c", "0,1,0"]), max_size=30)


@given(lines=LINES, above=st.lists(st.sampled_from(["", "# serial_number: 9"]), max_size=3))
def test_every_row_has_its_line(tmp_path_factory, lines, above):
    path = tmp_path_factory.mktemp("lines") / "a.csv"
    path.write_text("\n".join([*above, "ax_g,ay_g,az_g", *lines]) + "\n")
    told = [number for number, line in enumerate(path.read_text().splitlines(), 1) if line[:2] == "0,"]
    read = read_raw(path)
    assert len(read.readings) == len(told)
    assert read.row_numbers.tolist() == told
