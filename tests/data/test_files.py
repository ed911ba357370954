"""Position files: round trips to the bit, units, and bad files told by line and column."""

from dataclasses import fields, replace

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from position_text import HEADER, ROWS, faults, written

from tumblecal import InputError
from tumblecal.data import PositionSet, paper, read_positions, write_positions


def same(first: PositionSet, second: PositionSet) -> None:
    """Equal to the last bit in every column."""
    for column in fields(PositionSet):
        one, other = getattr(first, column.name), getattr(second, column.name)
        if column.name == "source":
            continue
        if isinstance(one, np.ndarray):
            assert other.dtype == np.float64 and one.tobytes() == other.tobytes(), column.name
        else:
            assert one == other, column.name


NUMBERS = st.floats(-360, 360, allow_subnormal=True).map(lambda x: x + 0.0)  # no minus zero: it is written as 0
LABELS = st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs", "Zl", "Zp"]), min_size=1, max_size=5).map(
    lambda text: ("p" + text).strip()
)


@st.composite
def columns_of_a_set(draw):
    """Columns, some of them left out; the set is made from them in the test (shape checks draw random numbers)."""
    count = draw(st.integers(1, 5))

    def column(elements=NUMBERS):
        return np.array(draw(st.lists(elements, min_size=count, max_size=count)), float)

    def labels():
        return tuple(draw(st.lists(LABELS, min_size=count, max_size=count)))

    def axes(elements=NUMBERS):
        return np.stack([column(elements) for _ in range(3)], axis=1)

    columns = {"names": labels(), "alpha_deg": column(), "beta_deg": column(), "readings": axes()}
    if draw(st.booleans()):
        columns["sd"] = axes(st.floats(1e-9, 1.0))
    if draw(st.booleans()):
        columns |= {"run": labels(), "mount": labels()}
    if draw(st.booleans()):
        columns |= {
            "time_s": column(),
            "temperature_degc": column(st.floats(-100, 250).map(lambda x: x + 0.0)),
            "n": column(st.integers(1, 10**9)),
        }
    if draw(st.booleans()):
        columns |= {"approach": column(st.sampled_from([-1, 1])), "comments": {"serial_number": "A 7: x", "k": ""}}
    return columns


@given(columns_of_a_set())
def test_csv_and_parquet_round_trips_are_bit_exact(tmp_path_factory, columns):
    data = PositionSet(**columns)
    folder = tmp_path_factory.mktemp("trips")
    for name in ("a.csv", "a.parquet"):
        write_positions(folder / name, data)
        try:
            same(data, read_positions(folder / name, check_size=False))
        except InputError as error:  # a draw may look like radians, or hours: such data are refused, not changed
            assert "look like radians" in str(error) or "look like hours or days" in str(error)
    assert sorted(path.name for path in folder.iterdir()) == ["a.csv", "a.parquet"]


def test_table1_is_the_papers(table1):
    assert len(table1) == 24
    assert table1.readings[0].tolist() == [-0.000112285876167, -0.000471302678915, 1.001236660128444]
    assert set(paper.table2()) == set(paper.SIMULATION_TRUTH)
    assert paper.table3()["largest"][0] == pytest.approx(0.46985e-3, rel=1e-4)
    np.testing.assert_allclose(np.linalg.norm(table1.readings, axis=1), 1.0, atol=3e-3)


@pytest.mark.parametrize(("unit", "one_g"), [("mg", 1000.0), ("ms2", 9.80665)])
def test_units_give_the_same_set(tmp_path, table1, unit, one_g):
    write_positions(tmp_path / "g.csv", replace(table1, sd=np.full((24, 3), 1e-4)))
    frame = pl.read_csv(tmp_path / "g.csv", comment_prefix="#")
    columns = [name for name in frame.columns if name.endswith("_g")]
    other = frame.with_columns([pl.col(name) * one_g for name in columns])
    other.rename({name: f"{name[:-2]}_{unit}" for name in columns}).write_csv(tmp_path / "other.csv")
    data = read_positions(tmp_path / "other.csv")
    np.testing.assert_allclose(data.readings, table1.readings, rtol=1e-15)
    np.testing.assert_allclose(data.sd, 1e-4, rtol=1e-15)


HEADER_CASES = {
    "missing column": (HEADER.replace("beta_deg,", ""), "a,0,0,0,1", "line 1: column beta_deg is missing; add it"),
    "missing axis": (HEADER.replace(",ay_g", ""), "a,0,0,0,1", "line 1: column ay_g (or _mg, _ms2) is missing"),
    "an sd misspelt": (HEADER + ",ax_sd_g,ay_sd_g,az_sdg", "a,0,0,0,0,1,1,1,1", "unknown column; did you mean az_sd_g?"),
    "a column twice": (HEADER + ",ax_g", "a,0,0,0,0,1,0", "column ax_g: the column is given twice; keep one"),
    "contradictory units": (HEADER + ",ax_mg", "a,0,0,0,0,1,0", "ax_g and ax_mg both give axis x; keep one"),
    "mixed units": (HEADER.replace("ay_g", "ay_mg"), "a,0,0,0,0,1", "are in different units; give the three axes in one unit"),
}  # fmt: skip


@pytest.mark.parametrize(("header", "row", "words"), HEADER_CASES.values(), ids=HEADER_CASES)
def test_faults_of_the_header(tmp_path, header, row, words):
    assert any(words in fault for fault in faults(written(tmp_path / "a.csv", header, row)))


CELL_CASES = {
    "no number": ("b,90,0,0.001,one,0.003", "column ay_g: 'one' is not a number"),
    "NaN": ("b,90,0,0.001,nan,0.003", "column ay_g: 'nan' is not a finite number"),
    "empty": ("b,90,0,,1,0.003", "column ax_g: the cell is empty"),
    "no reading": ("b,90,0,1e200,1,0.003", "column ax_g: 1e+200 g is not a possible reading"),
    "too few cells": ("b,90,0,1", "4 cells, but the header has 6"),
    "quotation mark": ('b,"90"x,0,0,1,0', "check the quotation marks"),
    "no name": (",90,0,0.001,1,0.003", "column position: the cell is empty; write the position in every row"),
    "missing": (
        "b,90,0,0,1,n/a",
        "column az_g: 'n/a' is a missing reading; measure the position again or remove the row",
    ),
    "names": (HEADER, "the names of the columns again"),
    "units": ("-,deg,deg,g,g,g", "a line of units, not a row"),
}


@pytest.mark.parametrize(("row", "words"), CELL_CASES.values(), ids=CELL_CASES)
def test_faults_of_a_cell_name_line_and_column(tmp_path, row, words):
    path = written(tmp_path / "a.csv", "# k: v", HEADER, ROWS[0], "", row, ROWS[2])
    (fault,) = faults(path)
    assert fault.startswith(f"{path}:line 5") and words in fault


def test_all_faults_are_told_at_once_and_many_are_cut_short(tmp_path):
    rows = [f"p{k},x,0,nan,0," for k in range(10)]
    told = faults(written(tmp_path / "a.csv", HEADER, *rows))
    assert [fault.split(": ")[0].split(", ")[-1] for fault in told] == [
        "column alpha_deg",
        "column ax_g",
        "column az_g",
    ]
    assert all(fault.endswith(" (also in lines 3, 4 and 7 more)") for fault in told)
    many = faults(written(tmp_path / "m.csv", ",".join(f"position{k}" for k in range(30)), ",".join("0" * 30)))
    assert len(many) == 21 and many[-1].endswith("more faults")
    ragged = faults(written(tmp_path / "r.csv", HEADER, *(f"p{k},1" for k in range(30))))
    assert len(ragged) == 1 and ragged[0].endswith(" (also in lines 3, 4 and 27 more)")


@pytest.mark.parametrize(
    ("size", "unit", "words"),
    [
        (9.81, "g", "look like m/s^2"),
        (1, "ms2", "look like g"),
        (0.1, "g", "a wrong scale"),
        (8, "g", "8 times the force, as with a wrong full-scale range"),
    ],
)
def test_values_that_contradict_their_unit(tmp_path, size, unit, words):
    header = HEADER.replace("_g", f"_{unit}")
    (fault,) = faults(written(tmp_path / "a.csv", header, f"a,0,0,0,0,{size}", f"b,90,0,0,{size},0"))
    assert words in fault and f"column ax_{unit}, ay_{unit}, az_{unit}" in fault
    read_positions(tmp_path / "a.csv", check_size=False)


FURTHER = [
    ("run", ("1", " ", "1"), "line 3, column run: the cell is empty; write the run in every row, or remove the whole"),
    ("n", ("1", "100", "0.5"), "line 4, column n: a mean has at least one sample"),
    ("approach", ("1", "2", "1"), "line 3, column approach: must be +1 or -1"),
    ("temperature_degc", ("20", "-300", "20"), "line 3, column temperature_degc: -300 degC is below absolute zero"),
]


@pytest.mark.parametrize(("name", "cells", "words"), FURTHER, ids=[name for name, *_ in FURTHER])
def test_faults_of_further_columns(tmp_path, name, cells, words):
    rows = (f"{row},{cell}" for row, cell in zip(ROWS, cells, strict=True))
    (fault,) = faults(written(tmp_path / "a.csv", f"{HEADER},{name}", *rows))
    assert words in fault


def test_files_that_are_no_table(tmp_path):
    (tmp_path / "bytes.csv").write_bytes(HEADER.encode() + b"\n\xff\xfe\x00\n")
    assert ":line 2: not text (byte 0xff)" in faults(tmp_path / "bytes.csv")[0]
    assert "no header line" in faults(written(tmp_path / "comments.csv", "# only: this"))[0]
    assert "no rows below the header" in faults(written(tmp_path / "header.csv", HEADER))[0]
    unnamed = faults(written(tmp_path / "unnamed.csv", "# p,alpha,beta,x,y,z", *ROWS))
    assert "line 2: numbers instead of the names of the columns; write the names in the first line" in unnamed[0]
    empty = {name: [0.0, 1.0] for name in HEADER.split(",")} | {"position": ["a", "b"], "ay_g": [1.0, None]}
    pl.DataFrame(empty).write_parquet(tmp_path / "a.parquet")
    assert ":row 2, column ay_g: the cell is empty" in faults(tmp_path / "a.parquet")[0]
    (tmp_path / "no.parquet").write_bytes(b"PAR1 not really")
    assert "not a complete Parquet file" in faults(tmp_path / "no.parquet")[0]


def test_cells_that_would_be_formulas_are_written_as_text_and_read_again(tmp_path):
    names = ("=cmd()", "+x", "-45", "-2+3|x", "@a", "'k")
    data = PositionSet(names, np.zeros(6), np.zeros(6), np.tile([0.0, 0.0, 1.0], (6, 1)), run=("=r",) * 6)
    write_positions(tmp_path / "p.csv", data)
    cells = [line.split(",")[0] for line in (tmp_path / "p.csv").read_text().splitlines()[1:]]
    assert cells == ["'=cmd()", "'+x", "-45", "'-2+3|x", "'@a", "'k"]
    read = read_positions(tmp_path / "p.csv")
    assert read.names == names and read.run == ("=r",) * 6
