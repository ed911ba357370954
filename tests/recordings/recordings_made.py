"""Recordings of one virtual hand-held session, written as other programs write them."""

import struct
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from damaged_made import imu_messages, write_ros1_bag
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


FACES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1.0]])


def faces_in_turn(faces: np.ndarray = FACES) -> np.ndarray:
    """Readings (n, 3) in g at 50 Hz: four seconds at rest on each face, with turns between them."""
    rng, parts = np.random.default_rng(3), []
    for face, after in zip(faces, np.roll(faces, -1, axis=0), strict=True):
        turn = np.linspace(0, 1, 25)[:, None]
        parts += [np.tile(face, (200, 1)), (1 - turn) * face + turn * after + 0.2 * np.sin(9 * turn)]
    force = np.concatenate(parts[:-1])
    return force + 1e-3 * rng.normal(size=force.shape)


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


def hdf5(path: Path, columns: Mapping[str, np.ndarray], *, matlab: bool = False) -> Path:
    """Datasets of a file, or the variables of a MATLAB file of version 7.3 with the objects that MATLAB adds."""
    import h5py

    with h5py.File(path, "w", userblock_size=512 if matlab else 0) as file:
        for name, values in columns.items():
            file[name] = values[None] if matlab else values
        if matlab:
            file["objects"] = np.zeros((600, 1), np.uint32)
            file["objects"].attrs["MATLAB_object_decode"] = 3
    if matlab:
        with path.open("r+b") as content:
            content.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return path


def _motion(s: Session) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time in s, force in m/s^2, rate in rad/s."""
    return s.time_s, G * s.force, np.radians(s.rate)


def ros1_bag(path: Path, s: Session, topic="/imu/data") -> Path:
    """A ROS 1 bag with an IMU."""
    return write_ros1_bag(path, topic, *_motion(s))


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
        for k, (stamp, message) in enumerate(imu_messages(store, *_motion(s))):
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
