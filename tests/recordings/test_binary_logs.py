"""DataFlash, Xbus and PX4 logs, written byte by byte as specified: every number, damage, and corrections by the device."""

import struct
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import polars as pl
import pytest
from recordings_made import SENSOR_COMBINED, ulog_of

from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.reading import read_recording as write_samples


IMU = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"


def fmt(number: int, name: str, formats: str, fields: str) -> bytes:
    length = 3 + struct.calcsize("<" + formats.replace("Z", "64s").replace("n", "4s").replace("N", "16s"))
    stated = struct.pack("<BB4s16s64s", number, length, name.encode(), formats.encode(), fields.encode())
    return b"\xa3\x95\x80" + stated


def dataflash(
    rows: np.ndarray, instances: int = 2, parameters: Mapping[str, float] = MappingProxyType({})
) -> list[bytes]:
    """Messages of `rows` (n, 6) of angular rates and accelerations; the second instance reads the negative of them."""
    messages = [
        fmt(0x80, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
        fmt(20, "MSG", "QZ", "TimeUS,Message"),
        fmt(40, "PARM", "QNf", "TimeUS,Name,Value"),
        fmt(21, "IMU", "QBffffffIIfBBHH", IMU),
        b"\xa3\x95\x14" + struct.pack("<Q64s", 5, b"ArduCopter"),
        *(b"\xa3\x95\x28" + struct.pack("<Q16sf", 1, name.encode(), value) for name, value in parameters.items()),
    ]
    for k, row in enumerate(rows):
        for own in range(instances):
            numbers = 10**6 + 2500 * k, own, *(row * (-1) ** own), 0, 0, 41.5, 1, 1, 400, 400
            messages.append(b"\xa3\x95\x15" + struct.pack("<QB6fIIfBBHH", *numbers))
    return messages


def dataflash_text(rows: np.ndarray, parameters: Mapping[str, float]) -> bytes:
    """The same as text, with messages of another kind between them."""
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns", "FMT, 1, 1, ATT, Qcc, TimeUS,Roll,Pitch"]
    lines += [f"FMT, 131, 43, IMU, QBffffffIIfBBHH, {IMU}", "FMT, 40, 31, PARM, QNf, TimeUS,Name,Value"]
    lines += [f"PARM, 1, {name}, {value}" for name, value in parameters.items()]
    for k, row in enumerate(rows):
        for own in (0, 1):
            numbers = 10**6 + 2500 * k, own, *(row * (-1) ** own).tolist(), 0, 0, 41.5, 1, 1, 400, 400
            lines.append(", ".join(["IMU", *map(repr, numbers)]))
        lines.append(f"ATT, {2500 * k}, 0.5, 0.25")
    return ("\n".join(lines) + "\n").encode()


@pytest.fixture
def rows():
    values = np.random.default_rng(2).normal([0, 0, 0, 1.0, -2.0, 9.5], size=(200, 6))
    return values.astype("<f4").astype(float)


def imported(path, out, options=RecordingOptions()):
    contents = write_samples(path, out, options)
    frame = pl.read_parquet(out)
    return contents, frame.select("ax_ms2", "ay_ms2", "az_ms2").to_numpy(), frame


DATAFLASH = {
    "log.bin": (lambda rows, parameters: b"".join(dataflash(rows, 2, parameters)), "IMU", "IMU/1"),
    "log.log": (dataflash_text, "IMU", "IMU/1"),
}


@pytest.mark.parametrize(("name", "form"), DATAFLASH.items())
def test_dataflash_messages_of_each_instance(tmp_path, rows, name, form):
    write, *topics = form
    (tmp_path / name).write_bytes(write(rows, {}))
    contents, force, frame = imported(tmp_path / name, tmp_path / "out.parquet")
    np.testing.assert_array_equal(force, rows[:, 3:])
    np.testing.assert_array_equal(frame.select("gx_rads", "gy_rads", "gz_rads").to_numpy(), rows[:, :3])
    np.testing.assert_allclose(frame["time_s"], 2.5e-3 * np.arange(200), atol=1e-12)
    assert set(frame["temperature_degc"]) == {41.5}
    assert [table.name for table in contents.tables] == topics
    assert contents.rate_hz == pytest.approx(400)
    assert not contents.damage.lines and not contents.unread.rows
    _, force, _ = imported(tmp_path / name, tmp_path / "out.parquet", RecordingOptions(topic=topics[1]))
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


TOPICS = SENSOR_COMBINED | {
    "sensor_accel": "uint64_t timestamp;uint32_t device_id;float x;float y;float z;float temperature;",
    "sensor_selection": "uint64_t timestamp;uint32_t accel_device_id;",
}


def ulog(rows: np.ndarray, parameters: dict[str, int], selected: int | None) -> bytes:
    """A PX4 log with the samples of the sensors and of the device."""
    data = [(2, struct.pack("<QI", 10**6, selected))] if selected is not None else []
    for k, row in enumerate(rows):
        time = 10**6 + 5000 * k
        data += [(0, struct.pack("<Q6f", time, *row)), (1, struct.pack("<QI4f", time, 77, *row[3:], 30.0 + k / 100))]
    return ulog_of(TOPICS, data, parameters)


CORRECTED = {"TC_A_ENABLE": 1, "TC_A0_ID": 77, "TC_A1_ID": 0}


@pytest.mark.parametrize(
    ("parameters", "selected", "topic", "warned"),
    [
        (CORRECTED, None, "sensor_combined", True),
        (CORRECTED, 77, "sensor_combined", True),
        (CORRECTED, 78, "sensor_combined", False),
        (CORRECTED, 77, "sensor_accel", False),
        (CORRECTED | {"TC_A_ENABLE": 0}, 77, "sensor_combined", False),
        (CORRECTED | {"TC_A0_ID": 0}, 77, "sensor_combined", False),
    ],
)
def test_px4_states_a_correction(tmp_path, rows, parameters, selected, topic, warned):
    pytest.importorskip("pyulog")
    (tmp_path / "log.ulg").write_bytes(ulog(rows, parameters, selected))
    contents = write_samples(tmp_path / "log.ulg", tmp_path / "out.csv", RecordingOptions(topic=topic))
    assert contents.damage.lines == (
        [
            "the device has corrected these readings for temperature (TC_A_ENABLE 1, TC_A0_ID 77), so a calibration "
            "corrects them twice: read --topic sensor_accel, which is not corrected, or record again with TC_A_ENABLE 0"
        ]
        if warned
        else []
    )
    again = write_samples(tmp_path / "out.csv", tmp_path / "again.parquet", RecordingOptions())
    assert again.damage.lines == contents.damage.lines


def test_damage_of_a_px4_log_is_reported(tmp_path, rows):
    log = ulog(rows, {}, None)
    for content, words, fewest in (
        (log + bytes(100), "is not the start of a message: data after it may be lost or wrong", len(rows)),
        (log[:-5], "the file ends within a message", len(rows) - 1),
    ):
        (tmp_path / "log.ulg").write_bytes(content)
        contents, _, frame = imported(tmp_path / "log.ulg", tmp_path / "out.parquet")
        (line,) = contents.damage.lines
        assert words in line and len(frame) >= fewest


@pytest.mark.parametrize(("name", "form"), DATAFLASH.items())
def test_ardupilot_states_a_correction(tmp_path, rows, name, form):
    """INS_TCAL1_ENABLE of the first sensor; 2 learns, and corrects nothing."""
    parameters = {"INS_TCAL1_ENABLE": 1.0, "INS_TCAL2_ENABLE": 2.0, "INS_TCAL3_ENABLE": 0.0, "INS_USE": 1.0}
    write, *topics = form
    (tmp_path / name).write_bytes(write(rows, parameters))
    first, second = (
        imported(tmp_path / name, tmp_path / "out.parquet", RecordingOptions(topic=topic))[0].damage.lines
        for topic in topics
    )
    assert not second
    assert first == [
        "the device has corrected these readings for temperature (INS_TCAL1_ENABLE 1), so a calibration corrects them "
        "twice: record again with INS_TCAL1_ENABLE 0"
    ]
