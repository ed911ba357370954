"""Texts with words around their numbers, pipes, a monitor's clock, JSON, logs of many messages: read as they were written."""

import json
import re

import numpy as np
import polars as pl
import pytest

from tumblecal.data.text_layout import ROW
from tumblecal.recordings.damage import Damage
from tumblecal.recordings.formats import tables_of
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.reading import read_recording as write_samples


ROWS = 60
RNG = np.random.default_rng(7)
FORCE = np.round(np.array([0.1, -0.2, 0.97]) + 0.01 * RNG.normal(size=(ROWS, 3)), 4)
RATE = np.round(RNG.normal(size=(ROWS, 3)), 3)
CLOCK = [f"10:00:{k // 100:02d}.{k % 100 * 10:03d}" for k in range(ROWS)]
HZ = 100.0


def imported(path, text: str, options: RecordingOptions = RecordingOptions(rate=HZ)):
    path.write_text(text)
    contents = write_samples(path, path.with_suffix(".parquet"), options)
    return pl.read_parquet(path.with_suffix(".parquet")), contents


def of_axes(frame: pl.DataFrame, kind: str) -> np.ndarray:
    return frame.select(pl.col(f"^{kind}[xyz]_.*$")).to_numpy()


AXES, RATES = "ax ay az", "gx gy gz"
# Lines before the rows; a row: k is its number, t its time, f and w its force and rate, c its clock; the names of the columns.
FORMS = {
    "pipes": ("t|ax|ay|az", "{t}|{f[0]}|{f[1]}|{f[2]}", f"t {AXES}"),
    "the Arduino monitor": ("", "{c} -> {f[0]},{f[1]},{f[2]}", "time 2 3 4"),
    "the Arduino monitor, times": (
        "{c} -> millis\tax\tay\taz",
        "{c} -> {t}\t{f[0]}\t{f[1]}\t{f[2]}",
        f"monitor millis {AXES}",
    ),
    "a monitor with brackets": ("", "[{c}] {f[0]} {f[1]} {f[2]}", "time 2 3 4"),
    "Serial Plotter, tabs": ("", "ax:{f[0]}\tay:{f[1]}\taz:{f[2]}\tgx:{w[0]}\tgy:{w[1]}\tgz:{w[2]}", f"{AXES} {RATES}"),
    "labels of three": (
        "",
        "N:{k}, Gyr: {w[0]}, {w[1]}, {w[2]}, Acc: {f[0]}, {f[1]}, {f[2]},",
        "N Gyr.x Gyr.y Gyr.z Acc.x Acc.y Acc.z",
    ),
    "records of three lines": (
        "",
        "Acc X: {f[0]}, Y: {f[1]}, Z: {f[2]} g\nRotation X: {w[0]}, Y: {w[1]}, Z: {w[2]} dps\nTemp: 25.5 degC\n",
        "Acc_X Acc_Y Acc_Z_[g]",
    ),
    "a word for three": (
        "",
        "Accel: X={f[0]} Y={f[1]} Z={f[2]} Gyro: X={w[0]} Y={w[1]} Z={w[2]}",
        "Accel_X Accel_Y Accel_Z Gyro_X Gyro_Y Gyro_Z",
    ),
    "units after labels": (
        "",
        "Scaled. Acc (mg) [ {f[0]:08.4f}, {f[1]:08.4f}, {f[2]:08.4f} ], Gyr (DPS) [ {w[0]}, {w[1]}, {w[2]} ]",
        "Scaled._Acc.x_[mg] Scaled._Acc.y_[mg] Scaled._Acc.z_[mg] Gyr.x_[DPS] Gyr.y_[DPS] Gyr.z_[DPS]",
    ),
    "labels and blanks": ("", "ax {f[0]} ay {f[1]} az {f[2]}", AXES),
    "a unit at each number": ("", "{f[0]} g, {f[1]} g, {f[2]} g", "1_[g] 2_[g] 3_[g]"),
}


@pytest.mark.parametrize("name", FORMS)
def test_numbers_between_words_are_those_written(tmp_path, name):
    above, row, names = FORMS[name]
    lines = [row.format(k=k, t=10 * k, f=FORCE[k], w=RATE[k], c=CLOCK[k]) for k in range(ROWS)]
    (tmp_path / "log.txt").write_text("\n".join([above.format(c=CLOCK[0]), *lines]) + "\n")
    _, (table, *others) = tables_of(tmp_path / "log.txt", RecordingOptions(), Damage())
    assert [column.replace(" ", "_") for column in table.columns] == names.split()
    assert [other.columns[0] for other in others] == (["Rotation X", "Temp [degC]"] if "three lines" in name else [])
    frame = pl.concat(table.pieces(table.columns))
    truth = {"f": FORCE, "w": RATE, "t": 10.0 * np.arange(ROWS)[:, None], "k": np.arange(ROWS)[:, None]}
    own = re.findall(r"{(\w)(?:\[(\d)\])?(?::.*?)?}", row.partition("\n")[0])
    for column, (kind, axis) in zip(table.columns[-len(own) :], own, strict=True):
        cells = frame[column].to_list()
        assert (cells if kind == "c" else [*map(float, cells)]) == (
            CLOCK if kind == "c" else truth[kind][:, int(axis or 0)].tolist()
        ), column


XSENS = "// Start Time: Unknown\n// Update Rate: 100.0Hz\n// Firmware Version: 4.0.2\n"
LVM, OWN = "***End_of_Header***\t\t\t\t\nX_Value\tV0\tV1\tV2\tComment", "time=1,ax=2,ay=3,az=4"
DOT = "DeviceTag:,A1\nOutputRate:,100Hz\n\n"
# Lines before the rows; a row: s is its time in s, n in 0.1 ms, k its number, f its force; options.
WRITTEN = {
    "a row for each axis": ("# a comment\nsensor,t,axis,value", "acc,{s},X,{f[0]}\nacc,{s},Y,{f[1]}\nacc,{s},Z,{f[2]}", {}),
    "rows of kinds": (
        "$FLYS,1\n$COL,IMU,time,ax,ay,az\n$UNIT,IMU,s,g,g,g\n$COL,BARO,time,pressure\n$UNIT,BARO,s,Pa\n$DATA",
        "$IMU,{s},{f[0]},{f[1]},{f[2]}\n$BARO,{s},101300",
        {},
    ),
    "GENEActiv": ("Device Type,GENEActiv\n", "2024-05-03 10:00:{s:06.3f},{f[0]},{f[1]},{f[2]},5,0,24.5", {}),
    "Xsens MT Manager": (f"{XSENS}SampleTimeFine\tAcc_X\tAcc_Y\tAcc_Z", "{n}\t{f[0]}\t{f[1]}\t{f[2]}", {}),
    "Xsens without times": (f"{XSENS}SampleTimeFine\tAcc_X\tAcc_Y\tAcc_Z", "\t{f[0]}\t{f[1]}\t{f[2]}", {}),
    "Xsens DOT": (f"{DOT}PacketCounter,SampleTimeFine,Acc_X,Acc_Y,Acc_Z", "{k:05d},{n}00,{f[0]},{f[1]},{f[2]}", {}),
    "a label before the names": ("Fields:,t,ax,ay,az", "{s},{f[0]},{f[1]},{f[2]}", {}),
    "names between commas": ("t,ax,ay,az", "{s} {f[0]} {f[1]} {f[2]}", {}),
    "a rate in words": ("sampled at 100 Hz", "ax:{f[0]} ay:{f[1]} az:{f[2]}", {}),
    "a line of units": ("clock;X;Y;Z\n(s);(g);(g);(g)", "{s};{f[0]};{f[1]};{f[2]}", {}),
    "LabVIEW": (f"LabVIEW\nSamples\t9\t9\t9\t\nX0\t0.0\t0.0\t0.0\t\n{LVM}", "{s}\t{f[0]}\t{f[1]}\t{f[2]}", {"columns": OWN}),
    "Empatica": ("1588337100,1588337100,1588337100\n100.0,100.0,100.0", "{f[0]},{f[1]},{f[2]}", {"columns": "ax=1,ay=2,az=3"}),
    "a sensor among several": ("sensor,t,ax,ay,az", "0,{s},9,9,9\n1,{s},{f[0]},{f[1]},{f[2]}", {"rows": "sensor=1"}),
}  # fmt: skip


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
@pytest.mark.parametrize("name", WRITTEN)
def test_layouts_of_loggers(tmp_path, name, encoding):
    above, row, options = WRITTEN[name]
    rows = [row.format(s=k / HZ, n=2**31 + 100 * k, k=k, f=FORCE[k]) for k in range(ROWS)]
    (tmp_path / "log.txt").write_text("\n".join([above, *rows, ""]), encoding=encoding)
    recording = write_samples(tmp_path / "log.txt", tmp_path / "out.parquet", RecordingOptions(**options))
    frame = pl.read_parquet(tmp_path / "out.parquet")
    np.testing.assert_array_equal(of_axes(frame, "a"), FORCE)
    assert recording.rate_hz == pytest.approx(HZ)
    assert ("time_s" in frame.columns) == (name not in ("a rate in words", "Xsens without times", "Empatica"))
    if "time_s" in frame.columns:
        np.testing.assert_allclose(frame["time_s"], np.arange(ROWS) / HZ, atol=1e-9)


def rows_of_json(**more) -> list[dict]:
    return [
        {"t": 10 * k, "accel": dict(zip("xyz", FORCE[k], strict=True)), "gyro": RATE[k].tolist(), **more}
        for k in range(ROWS)
    ]


JSON = {
    "lines": "\n".join(map(json.dumps, rows_of_json(ok=True, note="a, b"))),
    "lines, one of them torn": "\n".join([*map(json.dumps, rows_of_json()), '{"t": 3, "accel": {"x'][1:]),
    "a list": json.dumps(rows_of_json(), indent=1),
    "a list of lines": "[\n" + ",\n".join(map(json.dumps, rows_of_json())) + "\n]\n",
    "lists": json.dumps(
        {"t": [10 * k for k in range(ROWS)], "acc": dict(zip("xyz", FORCE.T.tolist(), strict=True))}
        | {"gyr": dict(zip("xyz", RATE.T.tolist(), strict=True))}
    ),
    "a list under a key": json.dumps({"device": "A", "samples": rows_of_json()}),
    "kinds": "\n".join(
        json.dumps({"sensor": name, "t": 10 * k} | dict(zip("xyz", own[k], strict=True)))
        for k in range(ROWS)
        for name, own in (("acc", FORCE), ("gyro", RATE))
    ),
}


@pytest.mark.parametrize("name", JSON)
def test_json(tmp_path, name):
    frame, contents = imported(tmp_path / "log.json", JSON[name], RecordingOptions(time_unit="ms"))
    truth = FORCE[1:] if "torn" in name else FORCE
    np.testing.assert_array_equal(of_axes(frame, "a"), truth)
    np.testing.assert_allclose(frame["time_s"], np.arange(len(truth)) / HZ, atol=1e-9)
    assert contents.unread.rows == ("torn" in name)
    if name != "kinds":
        np.testing.assert_array_equal(of_axes(frame, "g"), RATE[-len(truth) :])


_ODD = {
    "none": None,
    "a key twice": '{"ts": 1, "ts": 2.5, "ax": 1, "ay": 2, "az": 3, "note": "b"}',
    "twice for another": '{"ts": 1, "ts": 2.5, "ax": 1, "ay": 2, "note": "b"}',
    "a torn line": '{"ts": 1, "ax": 1, "ay',
    "another key": '{"ts": 1, "ax": 1, "ay": 2, "az": 3, "note": "b", "e": 1}',
    "a number in words": '{"ts": 1, "ax": "1", "ay": 2, "az": 3, "note": "b"}',
    "no number": '{"ts": NaN, "ax": 1, "ay": 2, "az": null, "note": "b"}',
    "escapes": '{"ts": 1, "ax": 1, "ay": 2, "az": 3, "note": "b\\u0041 \\"ax\\": "}',
    "a key among words": '{"ts": 1, "ax": 1, "ay": 2, "az": 3, "note": "ax"}',
    "digits": '{"ts": 9007199254740993, "ax": 1e-400, "ay": 0.1234567890123456789, "az": -0.0, "note": "ü"}',
    "blank": "",
    "no object": "garbage",
    "a list": "[1, 2]",
    "half a character": r'{"ts": "\ud83d"}',
}


@pytest.mark.parametrize("odd", _ODD.values(), ids=_ODD)
def test_json_lines_are_read_as_json_reads_each(tmp_path, odd):
    """All numbers to the last digit, the last of a key that comes twice, and the number of each line."""
    rng = np.random.default_rng(1)
    keys = ["ts", "ax", "ay", "az", "note"]
    rows = [dict(zip(keys, [*row, "ä"], strict=True)) for row in rng.normal(size=(1100, 4))]
    lines = [json.dumps(row, ensure_ascii=False) for row in rows]
    lines = lines if odd is None else [*lines[:1050], odd, *lines[1050:]]
    (tmp_path / "log.jsonl").write_text("\n".join(lines), encoding="utf-8")
    _, (table,) = tables_of(tmp_path / "log.jsonl", RecordingOptions(), Damage())
    got = pl.concat(table.pieces(keys))
    wanted = [(k, line) for k, line in enumerate(lines, 1) if line]
    assert got[ROW].to_list() == [k for k, _ in wanted]
    for row, (_, line) in zip(got.drop(ROW).rows(), wanted, strict=True):
        try:
            content = json.loads(line)
            json.dumps(content, ensure_ascii=False).encode()
        except ValueError:
            content = {}
        content = content if isinstance(content, dict) else {}
        numbers = tuple(None if (own := content.get(key)) is None else float(own) for key in keys[:4])
        assert repr(row[:4]) == repr(numbers)
        assert row[4] == content.get("note")
