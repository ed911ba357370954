"""Numbers of text recordings in any country's writing: read as they were meant, or refused with line and column."""

import csv
import io

import numpy as np
import polars as pl
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.capture.rows.sample_file import write_samples
from tumblecal.ground.decimal_marks import marks_of
from tumblecal.ground.errors import InputError


TURN = np.linspace(0, 2 * np.pi, 400)
FORCE = np.stack([np.cos(TURN), np.sin(TURN) * np.cos(2 * TURN), np.sin(TURN) * np.sin(2 * TURN)], axis=1)
COUNTS = np.round(16384 * FORCE)
TIME_MS = 10 * np.arange(len(TURN))


def written(value: float, digits: int, decimal: str, group: str = "") -> str:
    text = f"{value:,.{digits}f}"
    return text.replace(",", "g").replace(".", decimal).replace("g", group)


def lines_of(columns, separator: str, *, quoted: bool = False) -> str:
    text = io.StringIO()
    writer = csv.writer(text, delimiter=separator, quoting=csv.QUOTE_ALL if quoted else csv.QUOTE_MINIMAL)
    writer.writerows(zip(*columns, strict=True))
    return text.getvalue()


def imported(path, options: RecordingOptions = RecordingOptions()) -> pl.DataFrame:
    write_samples(path, path.with_suffix(".parquet"), options)
    return pl.read_parquet(path.with_suffix(".parquet"))


@pytest.mark.parametrize(
    ("separator", "decimal", "group", "quoted"),
    [
        *(
            (",", ",", "", True),
            (",", ",", ".", True),
            (",", ".", ",", True),
            (";", ",", ".", False),
            (";", ",", "", True),
        ),
        *(("\t", ".", ",", False), ("\t", ",", ".", True), (" ", ",", "", False), (";", ".", "", False)),
    ],
)
@pytest.mark.parametrize("counts", [False, True])
def test_every_number_is_what_was_written(tmp_path, separator, decimal, group, quoted, counts):
    values = COUNTS if counts else np.round(9.81 * FORCE, 5)
    columns = [[written(v, 3, decimal) for v in TIME_MS / 1000]]
    columns += [[written(v, 0 if counts else 5, decimal, group) for v in values[:, k]] for k in range(3)]
    path = tmp_path / "log.csv"
    path.write_text(separator.join(["time_s", "ax", "ay", "az"]) + "\n" + lines_of(columns, separator, quoted=quoted))
    frame = imported(path)
    np.testing.assert_allclose(frame["time_s"], TIME_MS / 1000, atol=1e-12)
    np.testing.assert_array_equal(frame.select(pl.col(f"^a[xyz]_{'counts' if counts else 'ms2'}$")).to_numpy(), values)


@given(
    st.lists(st.integers(-2_000_000, 2_000_000), min_size=8, max_size=60),
    st.sampled_from([0, 1, 2, 3, 4]),
    st.sampled_from([(".", ""), (",", ""), (".", ","), (",", ".")]),
    st.integers(0, 5),
)
def test_marks_of_one_column_are_never_the_wrong_ones(values, digits, marks, shrunk):
    """Whatever numbers a column holds, their marks are told right or not at all; points for decimals are usual."""
    decimal, group = marks
    numbers = [value / 10**shrunk if digits else value // 10**shrunk for value in values]
    cells = [written(value, digits, decimal, group) for value in numbers]
    assume(any(mark in cell for cell in cells for mark in ".,"))
    (found,) = marks_of([cells])
    only_groups_of_points = group == "." and not digits and not any(-1000 < value < 1000 and value for value in numbers)
    if found is not None and not only_groups_of_points:
        assert found[0] == decimal


def test_marks_far_behind_whole_numbers_are_not_taken_for_decimals(tmp_path):
    """Between the lines from which the layout is learned: the only ones with thousands."""
    rows = [f"{k};{k % 7};3;998\n" for k in range(60000)]
    rows[20000:20040] = [f"{k};{k % 7};3;1.0{k % 90 + 10}\n" for k in range(20000, 20040)]
    (tmp_path / "log.csv").write_text("time_ms;ax_mg;ay_mg;az_mg\n" + "".join(rows))
    with pytest.raises(InputError, match=r"line 20002, column az_mg: '1.030' is 1030, or 1.030: the mark may separate"):
        imported(tmp_path / "log.csv")


@pytest.mark.parametrize("end", ["\r", "\r\r\n", "\r\n"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_every_encoding_and_end_of_lines(tmp_path, end, encoding):
    rows = [f"{k / 100};{k % 7 / 10};0.2;0.97;25 °C" for k in range(300)]
    path = tmp_path / "log.csv"
    path.write_bytes(end.join(["time_s;ax_g;ay_g;az_g;Wärme", *rows, "", ""]).encode(encoding))
    frame = imported(path)
    np.testing.assert_allclose(frame["ax_g"], np.arange(300) % 7 / 10)
