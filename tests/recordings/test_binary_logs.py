"""DataFlash and Xbus logs, written here byte by byte as the formats are specified: every number, and damage in a line."""

import struct

import numpy as np
import polars as pl
import pytest

from tumblecal.ground.errors import InputError
from tumblecal.recordings.formats import xbus as xbus_file
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.reading import read_recording as write_samples


IMU = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"


def fmt(number: int, name: str, formats: str, fields: str) -> bytes:
    length = 3 + struct.calcsize("<" + formats.replace("Z", "64s").replace("n", "4s").replace("N", "16s"))
    stated = struct.pack("<BB4s16s64s", number, length, name.encode(), formats.encode(), fields.encode())
    return b"\xa3\x95\x80" + stated


def dataflash(rows: np.ndarray, instances: int = 2) -> list[bytes]:
    """Messages of `rows` (n, 6) of angular rates and accelerations; the second instance reads the negative of them."""
    messages = [
        fmt(0x80, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
        fmt(20, "MSG", "QZ", "TimeUS,Message"),
        fmt(21, "IMU", "QBffffffIIfBBHH", IMU),
        b"\xa3\x95\x14" + struct.pack("<Q64s", 5, b"ArduCopter"),
    ]
    for k, row in enumerate(rows):
        for own in range(instances):
            values = struct.pack(
                "<QB6fIIfBBHH", 10**6 + 2500 * k, own, *(row * (-1) ** own), 0, 0, 41.5, 1, 1, 400, 400
            )
            messages.append(b"\xa3\x95\x15" + values)
    return messages


@pytest.fixture
def rows():
    values = np.random.default_rng(2).normal([0, 0, 0, 1.0, -2.0, 9.5], size=(200, 6))
    return values.astype("<f4").astype(float)


def imported(path, out, options=RecordingOptions()):
    contents = write_samples(path, out, options)
    frame = pl.read_parquet(out)
    return contents, frame.select("ax_ms2", "ay_ms2", "az_ms2").to_numpy(), frame


def test_dataflash_messages_of_each_instance(tmp_path, rows):
    (tmp_path / "log.bin").write_bytes(b"".join(dataflash(rows)))
    contents, force, frame = imported(tmp_path / "log.bin", tmp_path / "out.parquet")
    np.testing.assert_array_equal(force, rows[:, 3:])
    np.testing.assert_array_equal(frame.select("gx_rads", "gy_rads", "gz_rads").to_numpy(), rows[:, :3])
    np.testing.assert_allclose(frame["time_s"], 2.5e-3 * np.arange(200), atol=1e-12)
    assert set(frame["temperature_degc"]) == {41.5}
    assert [table.name for table in contents.tables] == ["IMU", "IMU/1"]
    assert contents.rate_hz == pytest.approx(400)
    assert not contents.damage.lines
    _, force, _ = imported(tmp_path / "log.bin", tmp_path / "out.parquet", RecordingOptions(topic="IMU/1"))
    np.testing.assert_array_equal(force, -rows[:, 3:])


def test_dataflash_bytes_in_no_message_are_reported_and_the_rest_is_read(tmp_path, rows):
    messages = dataflash(rows, instances=1)
    torn = [*messages[:104], b"\xa3\x00garbage", *messages[104:-1], messages[-1][:20]]
    (tmp_path / "log.bin").write_bytes(b"".join(torn))
    contents, force, _ = imported(tmp_path / "log.bin", tmp_path / "out.parquet")
    np.testing.assert_array_equal(force, rows[:-1, 3:])
    at = len(b"".join(messages[:104]))
    assert contents.damage.lines == [f"29 bytes outside messages, the first at byte {at}: messages there are lost"]


def xbus(bus: int, kind: int, payload: bytes) -> bytes:
    size = struct.pack(">B", len(payload)) if len(payload) < 255 else struct.pack(">BH", 255, len(payload))
    body = bytes([bus, kind]) + size + payload
    return b"\xfa" + body + bytes([-sum(body) % 256])


def mtb(rows: np.ndarray, start: int = 0, force=0x4020) -> list[bytes]:
    """Configuration, then samples (0.1 ms: 25 a step) in double precision."""
    messages = [xbus(0xFF, 0x0D, bytes(258)), xbus(0xFF, 0x13, b"1.10"), xbus(0xFF, 0xC1, bytes(8))]
    for k, row in enumerate(rows):
        fields = [(0x1020, struct.pack(">H", k % 65536)), (0x1060, struct.pack(">I", (start + 25 * k) % 2**32))]
        fields += [(0x0810, struct.pack(">f", 30.25)), (force | 3, struct.pack(">3d", *row[3:]))]
        fields += [(0x8023, struct.pack(">3d", *row[:3])), (0xE020, struct.pack(">I", 1))]
        payload = b"".join(struct.pack(">HB", name, len(own)) + own for name, own in fields)
        messages.append(xbus(0xFF, 0x36, payload))
    return messages


def test_an_mtb_file(tmp_path, rows):
    # The time goes around 2^32.
    (tmp_path / "MT_1.mtb").write_bytes(b"".join(mtb(rows, start=2**32 - 1000)))
    contents = write_samples(tmp_path / "MT_1.mtb", tmp_path / "out.parquet", RecordingOptions())
    frame = pl.read_parquet(tmp_path / "out.parquet")
    np.testing.assert_allclose(frame.select("ax_g", "ay_g", "az_g").to_numpy() * 9.80665, rows[:, 3:], rtol=1e-14)
    np.testing.assert_allclose(
        np.radians(frame.select("gx_dps", "gy_dps", "gz_dps").to_numpy()), rows[:, :3], rtol=1e-14
    )
    np.testing.assert_allclose(frame["time_s"], 2.5e-3 * np.arange(200), atol=1e-9)
    assert set(frame["temperature_degc"]) == {30.25}
    assert contents.rate_hz == pytest.approx(400)


def test_the_pieces_of_an_mtb_file_do_not_change_it(tmp_path, rows, monkeypatch):
    (tmp_path / "log.mtb").write_bytes(b"".join(mtb(rows)) + b"\xfa\xff\x36")
    whole = write_samples(tmp_path / "log.mtb", tmp_path / "whole.parquet", RecordingOptions())
    monkeypatch.setattr(xbus_file, "_PIECE", 5_000)
    monkeypatch.setattr(xbus_file, "_BLOCK", 7)
    pieces = write_samples(tmp_path / "log.mtb", tmp_path / "pieces.parquet", RecordingOptions())
    frames = [pl.read_parquet(tmp_path / f"{name}.parquet") for name in ("whole", "pieces")]
    assert frames[0].equals(frames[1]) and len(frames[0]) == 200
    assert (
        pieces.damage.lines
        == whole.damage.lines
        == ["3 bytes outside messages with a correct sum, the first at byte 17287: left out"]
    )


def test_an_mtb_file_without_specific_force_says_what_it_holds(tmp_path, rows):
    (tmp_path / "a.mtb").write_bytes(b"".join(mtb(rows, force=0x4030)))
    with pytest.raises(InputError, match="free acceleration"):
        write_samples(tmp_path / "a.mtb", tmp_path / "out.parquet", RecordingOptions())
    awinda = [xbus(0xFF, 0x0D, bytes(258)), *(xbus(bus, 0x36, b"\xc8\x10\x2e" + bytes(46)) for bus in (1, 2, 1, 2))]
    (tmp_path / "b.mtb").write_bytes(b"".join(awinda))
    with pytest.raises(InputError, match="increments of an MTw"):
        write_samples(tmp_path / "b.mtb", tmp_path / "out.parquet", RecordingOptions())


@pytest.mark.parametrize("make", [dataflash, mtb])
def test_changed_bytes_are_rows_or_a_line(tmp_path, rows, make):
    log, rng = b"".join(make(rows[:20])), np.random.default_rng(4)
    for _ in range(10):
        content = bytearray(log)
        for at in rng.integers(0, len(log), 5):
            content[at] = rng.integers(256)
        (tmp_path / "log.bin").write_bytes(content[: rng.integers(len(log) // 2, len(log))])
        try:
            contents = write_samples(tmp_path / "log.bin", tmp_path / "out.parquet", RecordingOptions())
        except InputError as fault:
            assert "\n" not in str(fault)
        else:
            assert contents.rows <= 20


def test_dataflash_of_old_firmware_has_milliseconds_and_a_name_for_each_sensor(tmp_path, rows):
    fields = "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"
    log = fmt(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns") + fmt(130, "IMU2", "Iffffff", fields)
    log += b"".join(b"\xa3\x95\x82" + struct.pack("<I6f", 20 * k, *row) for k, row in enumerate(rows))
    (tmp_path / "old.bin").write_bytes(log)
    contents, force, frame = imported(tmp_path / "old.bin", tmp_path / "out.parquet")
    assert contents.table.name == "IMU2"
    np.testing.assert_array_equal(force, rows[:, 3:])
    np.testing.assert_allclose(frame["time_s"], 0.02 * np.arange(200), atol=1e-12)
