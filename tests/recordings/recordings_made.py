"""Recordings of one virtual hand-held session, written as other programs write them."""

import struct
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from hand_held_sessions import Hand, Session, session
from tumblecal.recordings.columns import Layout
from tumblecal.recordings.damage import Damage
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.table import Reader, Table


G = 9.80665
ATTITUDES = np.array(
    [[0, 0, 1], [0, 0.7, 0.714], [0, 1, 0], [0.6, -0.8, 0], [0.5, 0.5, -0.7], [-1, 0, 0], [0, -0.6, -0.8], [0.8, 0.1, 0.6]]
)  # fmt: skip

ANGLES = {"x_p": (0, -90), "x_n": (0, 90), "y_p": (90, 0), "y_n": (-90, 0), "z_p": (0, 0), "z_n": (180, 0)}


def recording_of(layout: Layout, path: str = "f", more_tables: Sequence[Table] = (), **known) -> Recording:
    """A text that is read, with what is known of its samples, and without any."""
    table = Table("", (), lambda columns: iter(()))
    reader, known = Reader("text", lambda path, start: True, lambda source: [table]), {"damage": Damage()} | known
    return Recording(Path(path), reader, [table, *more_tables], table, RecordingOptions(), layout, **known)


def made(hand: Hand | None = None, seed: int = 1, attitudes: np.ndarray = ATTITUDES) -> Session:
    """The session that most tests write."""
    return session(seed, attitudes, hand or Hand())


def text(
    path: Path, s: Session, separator: str, columns: dict[str, np.ndarray], *, comma=False, header=True, before=""
) -> Path:
    """A text of any layout."""
    rows = np.stack(list(columns.values()), axis=1)
    lines = [separator.join(f"{value:.9g}" for value in row) for row in rows]
    lines = [line.replace(".", ",") for line in lines] if comma else lines
    path.write_text(before + (separator.join(columns) + "\n" if header else "") + "\n".join(lines) + "\n")
    return path


def imu_columns(s: Session) -> dict[str, np.ndarray]:
    """Time in s, force in m/s^2, rate in rad/s, temperature."""
    columns = {"time": s.time_s} | {f"acc_{axis}": G * s.force[:, k] for k, axis in enumerate("xyz")}
    return columns | {f"gyr_{axis}": np.radians(s.rate[:, k]) for k, axis in enumerate("xyz")} | {"temp": s.warmth}


def _messages(s: Session, store, *, ros1: bool):
    types = store.types
    stamp, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
    vector, turn_type = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    imu, covariance = types["sensor_msgs/msg/Imu"], np.zeros(9)
    force, rate = G * s.force, np.radians(s.rate)
    for k, time in enumerate(s.time_s):
        nanoseconds = round(time * 1e9)
        at = stamp(sec=1_700_000_000 + nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        head = header(**({"seq": k} if ros1 else {}), stamp=at, frame_id="imu")
        own = imu(
            head, turn_type(0.0, 0.0, 0.0, 1.0), covariance, vector(*rate[k]), covariance, vector(*force[k]), covariance
        )
        yield 1_700_000_000 * 10**9 + nanoseconds, own


def ros1_bag(path: Path, s: Session, topic="/imu/data") -> Path:
    """A ROS 1 bag with an IMU."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer(path) as bag:
        connection = bag.add_connection(topic, "sensor_msgs/msg/Imu", typestore=store)
        for stamp, message in _messages(s, store, ros1=True):
            bag.write(connection, stamp, store.serialize_ros1(message, "sensor_msgs/msg/Imu"))
    return path


def ros2_bag(path: Path, s: Session, *, mcap: bool, with_imu=True) -> Path:
    """A ROS 2 bag (a folder) with an IMU, a temperature of its own topic, and a topic of strings."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    temperature, string = store.types["sensor_msgs/msg/Temperature"], store.types["std_msgs/msg/String"]
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    with Writer(path, version=9, storage_plugin=plugin) as bag:
        talk = bag.add_connection("/chatter", "std_msgs/msg/String", typestore=store)
        bag.write(talk, 1, store.serialize_cdr(string("hello"), "std_msgs/msg/String"))
        if not with_imu:
            return path
        imu = bag.add_connection("/imu/data", "sensor_msgs/msg/Imu", typestore=store)
        warm = bag.add_connection("/imu/temperature", "sensor_msgs/msg/Temperature", typestore=store)
        for k, (stamp, message) in enumerate(_messages(s, store, ros1=False)):
            if k % 10 == 0:
                own = temperature(message.header, float(s.warmth[k]), 0.0)
                bag.write(warm, stamp, store.serialize_cdr(own, "sensor_msgs/msg/Temperature"))
            bag.write(imu, stamp, store.serialize_cdr(message, "sensor_msgs/msg/Imu"))
    return path


def ulog_of(topics: dict[str, str], data: Iterable[tuple[int, bytes]], parameters: dict[str, int]) -> bytes:
    """A PX4 log: fields of each topic, payloads with the numbers of their topics, and integer parameters.

    The format is https://docs.px4.io/main/en/dev_log/ulog_file_format.html.
    """

    def message(kind: bytes, content: bytes) -> bytes:
        return struct.pack("<HB", len(content), kind[0]) + content

    out = [b"ULog\x01\x12\x35\x01" + bytes(8), message(b"B", bytes(40))]
    out += [message(b"F", f"{name}:{fields}".encode()) for name, fields in topics.items()]
    for name, value in parameters.items():
        key = f"int32_t {name}".encode()
        out.append(message(b"P", bytes([len(key)]) + key + struct.pack("<i", value)))
    out += [message(b"A", struct.pack("<BH", 0, number) + name.encode()) for number, name in enumerate(topics)]
    out += [message(b"D", struct.pack("<H", number) + payload) for number, payload in data]
    return b"".join(out)


SENSOR_COMBINED = {"sensor_combined": "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;"}


def ulog(path: Path, s: Session) -> Path:
    """A PX4 log with `sensor_combined`."""
    samples = zip(s.time_s, np.radians(s.rate), G * s.force, strict=True)
    data = ((0, struct.pack("<Q6f", round(time * 1e6) + 10**6, *rate, *force)) for time, rate, force in samples)
    path.write_bytes(ulog_of(SENSOR_COMBINED, data, {}))
    return path
