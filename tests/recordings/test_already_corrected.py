"""Logs whose parameters state that the readings are already corrected for temperature: one warning, in every command."""

import struct

import numpy as np
import pytest
from recordings_made import SENSOR_COMBINED, ulog_of
from test_binary_logs import dataflash, fmt

from tumblecal.cli.output import Output
from tumblecal.cli.thermal import _printed
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.reading import read_recording as write_samples
from tumblecal.recordings.thermal.read_thermal import thermal_reading


ROWS = np.random.default_rng(2).normal([0, 0, 0, 1.0, -2.0, 9.5], 0.01, size=(300, 6))


def parm(name: str, value: float) -> bytes:
    return b"\xa3\x95\x28" + struct.pack("<Q16sf", 1, name.encode(), value)


TOPICS = SENSOR_COMBINED | {
    "sensor_accel": "uint64_t timestamp;uint32_t device_id;float x;float y;float z;float temperature;",
    "sensor_selection": "uint64_t timestamp;uint32_t accel_device_id;",
}


def ulog(parameters: dict[str, int], selected: int | None) -> bytes:
    """A PX4 log with the samples of the sensors and of the device."""
    data = [(2, struct.pack("<QI", 10**6, selected))] if selected is not None else []
    for k, row in enumerate(ROWS):
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
def test_px4(tmp_path, parameters, selected, topic, warned):
    pytest.importorskip("pyulog")
    (tmp_path / "log.ulg").write_bytes(ulog(parameters, selected))
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


@pytest.mark.parametrize("form", ["binary", "text"])
def test_ardupilot(tmp_path, form):
    """INS_TCAL1_ENABLE of the first sensor; 2 learns, and corrects nothing."""
    parameters = {"INS_TCAL1_ENABLE": 1.0, "INS_TCAL2_ENABLE": 2.0, "INS_TCAL3_ENABLE": 0.0, "INS_USE": 1.0}
    if form == "binary":
        messages = [fmt(40, "PARM", "QNf", "TimeUS,Name,Value"), *(parm(*one) for one in parameters.items())]
        path, topics = tmp_path / "log.bin", ("IMU", "IMU/1")
        path.write_bytes(b"".join([*dataflash(ROWS)[:1], *messages, *dataflash(ROWS)[1:]]))
    else:
        path, topics = tmp_path / "log.log", ("IMU[0]", "IMU[1]")
        lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
        lines += ["FMT, 131, 43, IMU, QBffffff, TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"]
        lines += [f"PARM, 1, {name}, {value}" for name, value in parameters.items()]
        lines += [
            ", ".join(["IMU", str(5000 * k), str(i), *map(repr, row.tolist())])
            for k, row in enumerate(ROWS)
            for i in (0, 1)
        ]
        path.write_text("\n".join(lines) + "\n")
    first, second = (
        write_samples(path, tmp_path / "out.parquet", RecordingOptions(topic=topic)).damage.lines for topic in topics
    )
    assert not second
    assert first == [
        "the device has corrected these readings for temperature (INS_TCAL1_ENABLE 1), so a calibration corrects them "
        "twice: record again with INS_TCAL1_ENABLE 0"
    ]


def test_a_ramp_of_a_corrected_sensor_is_warned_of(capsys, tmp_path):
    """The warnings of a recording were not printed by `thermal`."""
    rng, degc = np.random.default_rng(5), np.linspace(20.0, 50.0, 3000)
    accelerations = [0.1, 0.2, 9.8] + 1e-3 * degc[:, None] + 0.01 * rng.normal(size=(3000, 3))
    messages = [*dataflash(ROWS)[:1], fmt(40, "PARM", "QNf", "TimeUS,Name,Value"), parm("INS_TCAL1_ENABLE", 1.0)]
    messages.append(fmt(21, "IMU", "QBffff", "TimeUS,I,AccX,AccY,AccZ,T"))
    for k, (row, own) in enumerate(zip(accelerations, degc, strict=True)):
        messages.append(b"\xa3\x95\x15" + struct.pack("<QB4f", 10**6 + 50_000 * k, 0, *row, own))
    (tmp_path / "ramp.bin").write_bytes(b"".join(messages))
    _printed(Output(), thermal_reading([tmp_path / "ramp.bin"]))
    assert capsys.readouterr().err.count("(INS_TCAL1_ENABLE 1), so a calibration corrects them twice") == 1
