"""What is wrong in a text recording or in the options for it is one line with the place and the remedy; nothing is written."""

import re

import polars as pl
import pytest

from tumblecal.ground.errors import InputError
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.reading import read_recording as write_samples


GOOD = "t,ax,ay,az", "{t},0.1,0.2,0.97"
# A header, rows with {t} (seconds) and {k} (number), options, and the fault.
FAULTS = [
    (*GOOD, {"columns": "ax=ax,ay=ax,az=az"}, "--columns ay=ax: column ax is ax already; name another column for each"),
    (*GOOD, {"columns": "ax=ax,ax=ay"}, "--columns ax=ax,ax=ay: ax is given twice; keep one"),
    (*GOOD, {"columns": "ax=nothing"}, "no such column"),
    (*GOOD, {"columns": "bx=1"}, "no such quantity"),
    (*GOOD, {"unit": "furlongs"}, "--unit furlongs: not a unit"),
    (*GOOD, {"scale": "ax=two"}, "not a number"),
    (*GOOD, {"scale": "ax=0"}, "--scale ax=0: must be finite and other than 0"),
    (*GOOD, {"offset": "nan"}, "--offset nan: must be finite"),
    (*GOOD, {"topic": "imu7"}, "no topic imu7"),
    ("t,ay,az", "{t},0.2,0.97", {}, "only ay, az among the columns 't, ay, az'; name the three: --columns ax"),
    ("time,ax,ay,az", "{k}e-12,0.1,0.2,0.97", {}, "no unit of the times is stated, and its steps are 1e-12"),
    ("time,ax,ay,az", "{t},0.1,0.2,0.97g", {}, "log.csv:line 2, column az: '0.97g': no number; write 0.97, without the unit"),
    ("warmth,ax,ay,az", "cold,0.1,0.2,0.97", {"columns": "temperature=warmth"}, "line 2, column warmth: 'cold': no number"),
    ("alpha_deg,ax,ay,az", "45:30,0.1,0.2,0.97", {}, "column alpha_deg: '45:30': no number; write degrees with decimals"),
    ("time,ax,ay,az", "10h05,0.1,0.2,0.97", {}, "column time: '10h05' cannot be read as a time; write"),
    ("time,ax,ay,az", "{k}0,0.1,0.2,0.97", {}, "give --time-unit s (0.1 Hz) or --time-unit ms (100 Hz)"),
    ("time,sensor,ax,ay,az", "{t},{d},0.1,0.2,0.97", {}, "select one: --rows sensor=0 or --rows sensor=1"),
    ("t,ax,ay,az", GOOD[1], {"rows": "sensor=1"}, "--rows sensor=1: no such column; the table has t, ax, ay, az"),
    ("t,ax_g,ay_mg,az_g", GOOD[1], {}, "ax_g, ay_mg, az_g are in different units; give the three axes in one unit"),
    ("t,ax_g,ax_g,az_g", GOOD[1], {}, "line 1, column ax_g: this name occurs twice; remove one, or give"),
    ("t,ax,ay,az", "0,{k},0,10,0,20,0,97", {}, "line 1: commas between cells are indistinguishable from decimal commas"),
    ("ax,ay,az,temp", "{k},0.1,0.2,0.97,25.0", {}, "line 1: names 4 columns, but the rows have 5 cells; correct the header"),
    ("ax ay az", "-5,59 8,8{d} 7,05", {}, "line 2, column ax: '-5,59': no number; its comma may be decimal: --decimal comma"),
    ("hello world", "no table", {}, "its first line 'hello world' has 2 cells separated by spaces, 0 of them numbers"),
    ("<html><body>x</body></html>", "", {}, "this is HTML or XML, not a table"),
    ('{"a": {"b": 1},\n "c": [\n]}', "", {}, "JSON without samples; samples are read from one object a line"),
    ('{{"a": {{"b": 1}}, "c": [', "]}}", {}, "not a complete JSON file"),
]  # fmt: skip


def text_of(header: str, row: str) -> str:
    lines = [row.format(t=f"{k / 100:.2f}", k=k, d=k % 10) for k in range(60)]
    return "\n".join([header.replace("{{", "{"), *lines, ""])


@pytest.mark.parametrize(("header", "row", "options", "words"), FAULTS, ids=[words for *_, words in FAULTS])
def test_a_fault_is_one_line(tmp_path, header, row, options, words):
    (tmp_path / "log.csv").write_text(text_of(header, row))
    with pytest.raises(InputError, match=re.escape(words)) as refused:
        write_samples(tmp_path / "log.csv", tmp_path / "out.parquet", RecordingOptions(**options))
    assert len(refused.value.faults) == 1 and not (tmp_path / "out.parquet").exists()


def test_what_the_user_states_is_used_in_place_of_a_fault(tmp_path):
    for header, row, options, column in (
        ("t,ax_g,ay_mg,az_g", GOOD[1], {"unit": "g"}, "az_g"),
        ("t,ax_g,ax_g,az_g", GOOD[1], {"columns": "time=1,ax=2,ay=3,az=4"}, "az_g"),
        ("time,ax,ay,az", "10:05,0.1,0.2,0.97", {"rate": 100.0}, "az_g"),
    ):
        (tmp_path / "log.csv").write_text(text_of(header, row))
        write_samples(tmp_path / "log.csv", tmp_path / "out.parquet", RecordingOptions(**options))
        frame = pl.read_parquet(tmp_path / "out.parquet")
        assert frame[column].to_list() == [0.97] * 60 and ("time_s" in frame.columns) == ("rate" not in options)
