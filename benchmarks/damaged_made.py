"""Small valid files of every format that tumblecal reads, made without tumblecal's readers."""

import io
import json
import struct
import zipfile
import zlib
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import polars as pl


G = 9.80665
_FACES = np.array([[0, 0, 1], [0, 0.7, 0.714], [0, 1, 0], [0.6, -0.8, 0], [0.5, 0.5, -0.7], [-1, 0, 0]])
_ROWS_OF_FACE, _RATE_HZ = 100, 50.0
_MCAP_MAGIC = b"\x89MCAP0\r\n"


def samples() -> dict[str, np.ndarray]:
    """A hand-held session: six attitudes of two seconds at 50 Hz; time in s, force in m/s^2, temperature in degC."""
    rng = np.random.default_rng(5)
    force = np.repeat(_FACES / np.linalg.norm(_FACES, axis=1, keepdims=True), _ROWS_OF_FACE, axis=0)
    force = G * (force + [0.02, -0.03, 0.01] + 2e-3 * rng.normal(size=force.shape))
    columns = {"time": np.arange(len(force)) / _RATE_HZ} | {f"acc_{axis}": force[:, k] for k, axis in enumerate("xyz")}
    return columns | {"temp": 25 + np.arange(len(force)) * 1e-3}


def text(separator: str = ",", number: str = "{:.6f}", *, comma: bool = False, header: str | None = None) -> bytes:
    """A recording as text, a row a line."""
    columns = samples()
    lines = [separator.join(number.format(value) for value in row) for row in zip(*columns.values(), strict=True)]
    lines = [line.replace(".", ",") for line in lines] if comma else lines
    return ((separator.join(columns) if header is None else header) + "\n" + "\n".join(lines) + "\n").encode()


def ulog() -> bytes:
    """A PX4 log of `sensor_combined` (https://docs.px4.io/main/en/dev_log/ulog_file_format.html)."""

    def message(kind: bytes, content: bytes) -> bytes:
        return struct.pack("<HB", len(content), kind[0]) + content

    own = samples()
    fields = "sensor_combined:uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;"
    out = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0), message(b"B", bytes(40)), message(b"F", fields.encode())]
    out.append(message(b"A", struct.pack("<BH", 0, 0) + b"sensor_combined"))
    for time, *force, _ in zip(*own.values(), strict=True):
        out.append(message(b"D", struct.pack("<HQ6f", 0, round(time * 1e6) + 10**6, 0.0, 0.0, 0.0, *force)))
    return b"".join(out)


def ulog_is_whole(content: bytes) -> bool:
    """Whether the messages of a log follow one another to its end."""
    at = 16
    while at + 3 <= len(content):
        size, kind = struct.unpack_from("<HB", content, at)
        if bytes([kind]) not in b"BFIMPQARDLCSO" or (kind == ord("D") and size != 34):
            return False
        at += 3 + size
    return at == len(content)


def log_is_whole(content: bytes) -> bool:
    """Whether the records of a capture's log follow one another to its end, each with its CRC-32."""
    at = 0
    while at + 24 <= len(content):
        magic, kind, size, stamp, check = struct.unpack_from("<4sIIqI", content, at)
        payload = content[at + 24 : at + 24 + size]
        if magic != b"\xa7TC\x01" or zlib.crc32(payload, zlib.crc32(struct.pack("<IIq", kind, size, stamp))) != check:
            return False
        at += 24 + size
    return at == len(content)


def json_lines() -> bytes:
    """A recording with an object in each line."""
    own = samples()
    rows = zip(*own.values(), strict=True)
    lines = [{"t": t, "acc": {"x": x, "y": y, "z": z}, "temp": degc} for t, x, y, z, degc in rows]
    return "".join(json.dumps(line) + "\n" for line in lines).encode()


def labelled() -> bytes:
    """A recording with its names in every line, as sketches for a serial plotter print."""
    own = samples()
    rows = zip(*own.values(), strict=True)
    return "".join(f"t:{t:.3f},ax:{x:.5f},ay:{y:.5f},az:{z:.5f}\n" for t, x, y, z, _ in rows).encode()


def dataflash() -> bytes:
    """An ArduPilot log (https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html)."""

    def stated(number: int, length: int, name: str, formats: str, fields: str) -> bytes:
        texts = (name.encode(), formats.encode(), fields.encode())
        return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, length, *texts)

    own = samples()
    out = [stated(0x80, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    out.append(stated(21, 23, "IMU", "Qfff", "TimeUS,AccX,AccY,AccZ"))
    for time, *force, _ in zip(*own.values(), strict=True):
        out.append(b"\xa3\x95\x15" + struct.pack("<Q3f", round(time * 1e6) + 10**6, *force))
    return b"".join(out)


def dataflash_is_whole(content: bytes) -> bool:
    """Whether the messages of a log follow one another to its end."""
    at, lengths = 0, {0x80: 89, 21: 23}
    while at + 3 <= len(content):
        if content[at : at + 2] != b"\xa3\x95" or content[at + 2] not in lengths:
            return False
        at += lengths[content[at + 2]]
    return at == len(content)


def mtb() -> bytes:
    """An Xsens log: a message for each sample with SampleTimeFine and acceleration, each with its checksum."""
    own, out = samples(), []
    for time, *force, _ in zip(*own.values(), strict=True):
        fields = struct.pack(">HBI", 0x1060, 4, round(time * 1e4)) + struct.pack(">HB3f", 0x4020, 12, *force)
        body = bytes([0xFF, 0x36, len(fields)]) + fields
        out.append(b"\xfa" + body + bytes([-sum(body) % 256]))
    return b"".join(out)


def mimu() -> bytes:
    """A log of the MIMU4444: two IMUs a frame."""
    out, own = [], samples()
    for k, (time, *force, _) in enumerate(zip(*own.values(), strict=True)):
        counts = [round(value / G * 2048) for value in force] + [0, 0, 0]
        body = b"\xaa" + struct.pack(">HBI12h", k % 65536, 28, round(time * 64e6), *counts, *counts)
        out.append(body + struct.pack(">H", sum(body) & 0xFFFF))
    return b"".join(out)


def ros1_bag() -> bytes:
    """A ROS 1 bag with an IMU."""
    with TemporaryDirectory() as folder:
        return write_ros1_bag(Path(folder) / "log.bag", "/imu", *motion()).read_bytes()


def write_ros1_bag(path: Path, topic: str, time_s: np.ndarray, force: np.ndarray, rate: np.ndarray) -> Path:
    """A ROS 1 bag with an IMU: force in m/s^2, rate in rad/s."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer(path) as bag:
        connection = bag.add_connection(topic, "sensor_msgs/msg/Imu", typestore=store)
        for stamp, message in imu_messages(store, time_s, force, rate, ros1=True):
            bag.write(connection, stamp, store.serialize_ros1(message, "sensor_msgs/msg/Imu"))
    return path


def ros2_bag(*, mcap: bool) -> bytes:
    """The file of a ROS 2 bag with an IMU: MCAP, or SQLite."""
    return next(own for name, own in ros2_folder(mcap=mcap).items() if name.endswith((".mcap", ".db3")))


def ros2_folder(*, mcap: bool) -> dict[str, bytes]:
    """The files of a ROS 2 bag."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "log"
        with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3) as bag:
            connection = bag.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
            for stamp, message in imu_messages(store, *motion()):
                bag.write(connection, stamp, store.serialize_cdr(message, "sensor_msgs/msg/Imu"))
        return {f"log/{own.name}": own.read_bytes() for own in path.iterdir()}


def motion() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, force and rate of the samples; they are at rest."""
    own = samples()
    force = np.stack([own[f"acc_{axis}"] for axis in "xyz"], axis=1)
    return own["time"], force, np.zeros_like(force)


def imu_messages(store, time_s: np.ndarray, force: np.ndarray, rate: np.ndarray, *, ros1: bool = False):
    """Stamps and messages of an IMU from some moment on: force in m/s^2, rate in rad/s."""
    types = store.types
    stamp, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
    vector, turn = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    imu, covariance = types["sensor_msgs/msg/Imu"], np.zeros(9)
    for k, (time, spun, pushed) in enumerate(zip(time_s.tolist(), rate.tolist(), force.tolist(), strict=True)):
        nanoseconds = 1_700_000_000 * 10**9 + round(time * 1e9)
        at = stamp(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        head, upright = header(**({"seq": k} if ros1 else {}), stamp=at, frame_id="imu"), turn(0.0, 0.0, 0.0, 1.0)
        yield nanoseconds, imu(head, upright, covariance, vector(*spun), covariance, vector(*pushed), covariance)


def with_mcap_checks(content: bytes) -> bytes:
    """An MCAP file with the CRC-32 of each chunk, of the data and of the summary (https://mcap.dev/spec)."""
    out = bytearray(content)
    at, summary = len(_MCAP_MAGIC), len(content)
    while at < len(content) - len(_MCAP_MAGIC):
        kind, size = content[at], struct.unpack_from("<Q", content, at + 1)[0]
        body = at + 9
        if kind == 0x06:
            name = struct.unpack_from("<I", content, body + 28)[0]
            packed = struct.unpack_from("<Q", content, body + 32 + name)[0]
            start = body + 40 + name
            struct.pack_into("<I", out, body + 24, zlib.crc32(content[start : start + packed]))
        if kind == 0x0F:
            struct.pack_into("<I", out, body, zlib.crc32(out[:at]))
            summary = at + 9 + size
        if kind == 0x02:
            struct.pack_into("<I", out, body + 16, zlib.crc32(out[summary : body + 16]))
        at = body + size
    return bytes(out)


def hdf5(*, checked: bool) -> bytes:
    """Datasets of a file; `checked`: in chunks with Fletcher's checksum."""
    import h5py

    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        for name, values in samples().items():
            more = {"fletcher32": True, "chunks": (100,)} if checked else {}
            file.create_dataset(name, data=values, **more)
    return out.getvalue()


def matlab(*, compressed: bool) -> bytes:
    """A MATLAB file, version 5."""
    from scipy.io import savemat

    out = io.BytesIO()
    savemat(out, samples(), do_compression=compressed)
    return out.getvalue()


def spreadsheet() -> bytes:
    """A sheet of a recording."""
    out = io.BytesIO()
    pl.DataFrame(samples()).write_excel(out, autofit=False, dtype_formats={pl.Float64: "0.000000"})
    return out.getvalue()


def zip_is_whole(content: bytes) -> bool:
    """Whether all members of a zip archive have their CRC-32."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return archive.testzip() is None
    except Exception:
        return False


def position_rows() -> dict[str, list]:
    """Means of 24 positions on a dividing head, in g, six decimals."""
    rng = np.random.default_rng(2)
    beta, alpha = (own.ravel() for own in np.meshgrid([0, 45, 90], np.arange(0, 360, 45), indexing="ij"))
    a, b = np.radians(alpha), np.radians(beta)
    force = np.stack([-np.sin(b), np.cos(b) * np.sin(a), np.cos(b) * np.cos(a)], axis=1)
    force = force * [1.001, 0.998, 1.0] + [2e-3, -1e-3, 3e-3] + 1e-4 * rng.normal(size=force.shape)
    rows = {"position": [f"p{k}" for k in range(24)], "alpha_deg": alpha.tolist(), "beta_deg": beta.tolist()}
    return rows | {f"a{axis}_g": np.round(force[:, k], 6).tolist() for k, axis in enumerate("xyz")}


def positions(separator: str = ",", ends: str = "\n", number: str = "{:.6f}", one_g: float = 1.0) -> bytes:
    """A position file."""
    rows = position_rows()
    cells = [
        [number.format(one_g * cell) if isinstance(cell, float) else str(cell) for cell in row]
        for row in zip(*rows.values(), strict=True)
    ]
    return ends.join([separator.join(rows), *map(separator.join, cells), ""]).encode()


def positions_ms2() -> bytes:
    """The same in m/s^2."""
    content = positions(number="{:.5f}", one_g=9.8123).replace(b"_g", b"_ms2")
    return b"# gravity_ms2: 9.8123\n" + content


def table_of_samples() -> bytes:
    """Raw samples with their positions beside them."""
    rows, rng = position_rows(), np.random.default_rng(4)
    lines = ["position,alpha_deg,beta_deg,time_s,ax_g,ay_g,az_g"]
    for k in range(24):
        for j in range(16):
            force = (f"{rows[f'a{axis}_g'][k] + 1e-3 * rng.normal():.6f}" for axis in "xyz")
            lines.append(f"p{k},{rows['alpha_deg'][k]},{rows['beta_deg'][k]},{k * 60 + j / 10:.1f},{','.join(force)}")
    return ("\n".join(lines) + "\n").encode()
