"""The columns of a text and the forms of its clock, by names, units and values; faults are one line, and nothing is written."""

import re
from datetime import datetime, timedelta

import numpy as np
import polars as pl
import pytest

from tumblecal.ground.errors import InputError
from tumblecal.recordings.description import write_description
from tumblecal.recordings.library import read_recording
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.reading import read_recording as write_samples


ROWS = 60
RISING = [f"{10 + k / 100:.2f}" for k in range(ROWS)]
WARM = [f"{25 + k * 7 % 5 / 10:.1f}" for k in range(ROWS)]


def imported(path, columns, options: RecordingOptions = RecordingOptions()) -> tuple[pl.DataFrame, str]:
    """The samples of a log with these columns and three accelerations, and what was said."""
    columns |= {"ax": ["0.1"] * ROWS, "ay": ["0.2"] * ROWS, "az": ["0.97"] * ROWS}
    rows = [",".join(columns), *map(",".join, zip(*columns.values(), strict=True))]
    path.write_text("\n".join(rows) + "\n")
    contents = write_samples(path, path.with_suffix(".parquet"), options)
    return pl.read_parquet(path.with_suffix(".parquet")), "\n".join(contents.layout.notes)


@pytest.mark.parametrize(
    ("columns", "options"),
    [
        ({"t": RISING, "temp": WARM}, ""),
        ({"t": RISING, "T": WARM}, ""),
        ({"T": WARM, "time": RISING}, ""),
        ({"T": WARM, "u": RISING}, "time=u"),
        ({"Zeit [s]": RISING, "Temperatur [°C]": WARM}, ""),
    ],
)
def test_t_is_the_time_beside_a_temperature_and_the_other_way_round(tmp_path, columns, options):
    frame, _ = imported(tmp_path / "log.csv", dict(columns), RecordingOptions(columns=options))
    np.testing.assert_allclose(frame["time_s"], np.arange(ROWS) / 100, atol=1e-9)
    np.testing.assert_array_equal(frame["temperature_degc"], [float(cell) for cell in WARM])


@pytest.mark.parametrize(
    ("columns", "found"),
    [
        ({"t": RISING}, {"time_s"}),
        ({"t": WARM}, set()),
        ({"T": RISING}, set()),
    ],
)
def test_t_alone_is_a_time_that_rises_and_a_capital_letter_needs_a_time(tmp_path, columns, found):
    frame, _ = imported(tmp_path / "log.csv", dict(columns))
    assert {"time_s", "temperature_degc"} & {*frame.columns} == found


BEGIN = datetime(2026, 3, 29, 23, 59, 59, 700000)


@pytest.mark.parametrize(
    "form",
    [
        *("%Y-%m-%dT%H:%M:%S.%f+02:00", "%Y/%m/%d %H:%M:%S.%f", "%d.%m.%y %H:%M:%S.%f", "%d/%m/%Y %H:%M:%S.%f"),
        *("%m/%d/%Y %I:%M:%S.%f %p", "%H:%M:%S.%f", "%I:%M:%S.%f %p"),
    ],
)
def test_clocks_are_read_over_midnight(tmp_path, form):
    """Without a date, over noon."""
    begin = BEGIN if "d" in form else datetime(2026, 4, 5, 12, 59, 59, 700000)
    times = [(begin + timedelta(milliseconds=10 * k)).strftime(form) for k in range(ROWS)]
    frame, _ = imported(tmp_path / "log.csv", {"timestamp": times})
    np.testing.assert_allclose(frame["time_s"], np.arange(ROWS) / 100, atol=1e-9)


@pytest.mark.parametrize(
    "parts",
    [
        {"Date": "%Y-%m-%d", "Time": "%H:%M:%S.%f"},
        {"Datum": "%d.%m.%y", "Uhrzeit": "%H:%M:%S,%f"},
        {"Date": "%Y%m%d", "Time": "%I:%M:%S.%f %p"},  # no date of a known form: the time of day passes midnight
        {"Date": "%m/%d/%Y", "Time": "%H:%M:%S", "us": "%f"},
        {"Hour": "%H", "Minute": "%M", "Second": "%S.%f"},
        {"epoch_s": "%s", "Time_us": "%f"},
    ],
)
def test_a_clock_in_several_columns(tmp_path, parts):
    """Dates, times of day, minutes, whole seconds and fractions, over midnight; the description gives the same clock."""
    times = [BEGIN + timedelta(milliseconds=10 * k) for k in range(ROWS)]
    columns = {name: [time.strftime(form).replace(",", ".") for time in times] for name, form in parts.items()}
    frame, _ = imported(tmp_path / "log.csv", columns)
    np.testing.assert_allclose(frame["time_s"], np.arange(ROWS) / 100, atol=3e-7)  # of seconds since 1970
    recording = read_recording(tmp_path / "log.csv")
    write_description(recording, tmp_path / "log.csv.recording.toml")
    described = read_recording(tmp_path / "log.csv.recording.toml")
    assert described.begin_s == recording.begin_s and "time" in described.layout.columns


GOOD = "t,ax,ay,az", "{t},0.1,0.2,0.97"
# A header, rows with {t} (seconds) and {k} (number), options, and the fault.
FAULTS = [
    (*GOOD, {"columns": "ax=ax,ay=ax,az=az"}, "--columns ay=ax: give each quantity one column, and no column twice"),
    (*GOOD, {"columns": "ax=ax,ax=ay"}, "--columns ax=ax,ax=ay: write pairs such as"),
    (*GOOD, {"columns": "bx=1"}, "--columns bx=1: give each quantity one column, and no column twice. Quantities: ax, ay"),
    (*GOOD, {"unit": "furlongs"}, "--unit furlongs: not a unit"),
    (*GOOD, {"scale": "ax=two"}, "--scale ax=two: not a finite number"),
    (*GOOD, {"scale": "ax=0"}, "--scale ax=0: not a finite number (a scale: other than 0)"),
    (*GOOD, {"offset": "nan"}, "--offset nan: not a finite number"),
    (*GOOD, {"topic": "imu7"}, "no topic imu7"),
    ("t,ay,az", "{t},0.2,0.97", {}, "name the accelerations among the columns 't, ay, az': --columns ax"),
    ("Time,Gx,Gy,Gz", GOOD[1], {}, "name the accelerations among the columns 'Time, Gx, Gy, Gz': --columns ax=Gx,ay=Gy"),
    ("Time,linear_x,linear_acc_x,linear_acc_y,linear_acc_z", "{t},1,0.1,0.2,0.97", {}, "without the size of gravity"),
    ("Time (10us),ax,ay,az", "{k}000,0.1,0.2,0.97", {}, "no unit of the times is stated, and its steps are 1000"),
    ("time,ax,ay,az", "{k}e-12,0.1,0.2,0.97", {}, "no unit of the times is stated, and its steps are 1e-12"),
    ("time,ax,ay,az", "{t},0.1,0.2,0.97g", {}, "lines 2 to 61, column az: '0.97g': no number; write 0.97, without the unit"),
    ("warmth,ax,ay,az", "cold,0.1,0.2,0.97", {"columns": "temperature=warmth"}, "2 to 61, column warmth: 'cold': no number"),
    ("time,ax,ay,az", "{t},low,high,mid", {}, "log.csv:lines 2 to 61, columns ax, ay, az: 'low': no number"),
    ("time,temp,ax,ay,az,p", "{t},25.{d},low,0.2,mid,{k}", {}, "lines 2 to 61, columns ax, az: 'low': no number"),
    ("alpha_deg,ax,ay,az", "45:30,0.1,0.2,0.97", {}, "column alpha_deg: '45:30': no number; write degrees with decimals"),
    ("time,ax,ay,az", "10h05,0.1,0.2,0.97", {"columns": "time=time"}, "column time: '10h05' cannot be read as a time; write"),
    ("time,ax,ay,az", "{k}0,0.1,0.2,0.97", {}, "give: --time-unit s (0.1 Hz) or --time-unit ms (100 Hz)"),
    ("time,sensor,ax,ay,az", "{t},{d},0.1,0.2,0.97", {}, "select one: --rows sensor=0 or --rows sensor=1"),
    ("t,ax,ay,az", GOOD[1], {"rows": "sensor=1"}, "--rows sensor=1: no such column; the table has t, ax, ay, az"),
    ("t,ax_g,ay_mg,az_g", GOOD[1], {}, "ax_g, ay_mg, az_g are in different units; give the three axes in one unit"),
    ("t,ax_g,ax_g,az_g", GOOD[1], {}, "line 1: column ax_g: this name occurs twice; correct the header line, or give"),
    ("t,ax,ay,az", "0,{k},0,10,0,20,0,97", {}, "line 1: names 4 columns, but the rows have 8 cells; write decimal"),
    ("ax,ay,az,temp", "{k},0.1,0.2,0.97,25.0", {}, "line 1: names 4 columns, but the rows have 5 cells; correct the header"),
    ("ax ay az", "-5,59 8,8{d} 7,05", {}, "ax, ay, az: '-5,59': no number; its comma may be decimal: --decimal comma"),
    ("time,ax,ay,az", "{k},{u},0.97", {}, "log.csv: no row has a number in each of ax, ay, az"),
    (*GOOD, {"scale": "gx=2"}, "--scale: gx is not among the columns; there are ax, ay, az, time"),
    (*GOOD, {"time_unit": "d"}, "--time-unit d: not known; write one of s, ms, us, ns"),
    (*GOOD, {"decimal": "dot"}, "--decimal dot: write point or comma"),
    (*GOOD, {"rate": -1.0}, "--rate -1: not a sample rate; give samples a second, above 0 and below 1e7"),
    ("a,b,c,d", GOOD[1], {"columns": "ax=2"}, "ay, az not found among the columns 'a, b, c, d'; name them: --columns"),
    ("time,position_x,position_y,position_z", GOOD[1], {}, "name the accelerations among the columns 'time, position_x"),
    ("t,acc1,acc5,acc7", GOOD[1], {}, "columns 't, acc1, acc5, acc7': --columns ax=...,ay"),
    ("hello world", "no table", {}, "first line 'hello world' has 2 cells separated by spaces, 0 of them numbers"),
    ("time,ax,ay,az", "", {}, "log.csv: no rows"),
    ('{"a": {"b": 1},\n "c": [\n]}', "", {}, "JSON without samples; samples are read from one object a line"),
    ('{{"a": {{"b": 1}}, "c": [', "]}}", {}, "not a complete JSON file"),
    ('{{"e": "b", "t": 0, "u": 1}', '{{"e": "a", "t": {t}, "x": 0.1, "y": 1}}', {}, "choose one: --topic b or --topic a"),
]  # fmt: skip


def text_of(header: str, row: str) -> str:
    lines = [row.format(t=f"{k / 100:.2f}", k=k, d=k % 10, u=("0.1,y", "x,0.2")[k % 2]) for k in range(ROWS)]
    return "\n".join([header.replace("{{", "{"), *lines, ""])


@pytest.mark.parametrize(("header", "row", "options", "words"), FAULTS, ids=[words for *_, words in FAULTS])
def test_a_fault_is_one_line(tmp_path, header, row, options, words):
    (tmp_path / "log.csv").write_text(text_of(header, row))
    with pytest.raises(InputError, match=re.escape(words)) as refused:
        write_samples(tmp_path / "log.csv", tmp_path / "out.parquet", RecordingOptions(**options))
    assert len(refused.value.faults) == 1 and not (tmp_path / "out.parquet").exists()
