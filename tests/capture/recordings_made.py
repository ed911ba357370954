"""Recordings of one virtual hand-held session, written as other programs write them."""

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np


RATE_HZ, G = 100.0, 9.80665
ATTITUDES = np.array(
    [[0, 0, 1], [0, 0.7, 0.714], [0, 1, 0], [0.6, -0.8, 0], [0.5, 0.5, -0.7], [-1, 0, 0], [0, -0.6, -0.8], [0.8, 0.1, 0.6]]
)  # fmt: skip


@dataclass(frozen=True)
class Session:
    """Samples: time in s, force in g (n, 3), rate in deg/s (n, 3), temperature in degC; `still` (k, 2) rows of the dwells."""

    time_s: np.ndarray
    force: np.ndarray
    rate: np.ndarray
    warmth: np.ndarray
    still: np.ndarray


def session(
    seed=1, dwell_s=(3.0, 4.0), turn_s=(0.6, 1.5), *, attitudes=ATTITUDES, sigma_g=2e-3, tremor_g=0.0, rate_hz=RATE_HZ
) -> Session:
    """A triad laid on one side after another: white noise, a hand's tremor in each dwell, smooth turns between."""
    rng = np.random.default_rng(seed)
    units = attitudes / np.linalg.norm(attitudes, axis=1, keepdims=True)
    force, rate, still, rows = [], [], [], 0
    for k, unit in enumerate(units):
        count = round(rng.uniform(*dwell_s) * rate_hz)
        own = np.repeat(unit[None], count, axis=0) + tremor_g * rng.uniform(0.3, 1.0) * tremor(rng, count, rate_hz)
        force.append(own)
        rate.append(2.0 * tremor_g * 100 * rng.normal(size=(count, 3)))
        still.append((rows, rows + count))
        rows += count
        if k + 1 < len(units):
            turned, spun = turn(rng, unit, units[k + 1], round(rng.uniform(*turn_s) * rate_hz), rate_hz)
            force.append(turned)
            rate.append(spun)
            rows += len(turned)
    n = rows
    whole = np.concatenate(force) * 1.01 + [0.02, -0.03, 0.05] + sigma_g * rng.normal(size=(n, 3))
    spun = np.concatenate(rate) + [0.4, -0.2, 0.1] + 0.05 * rng.normal(size=(n, 3))
    time_s = np.arange(n) / rate_hz
    return Session(time_s, whole, spun, 25 + 0.01 * time_s, np.array(still))


def tremor(rng, count, rate_hz):
    """A few unsteady oscillations of 4 to 12 Hz of a hand, (count, 3), of size about one."""
    times = np.arange(count) / rate_hz
    waves = [np.sin(2 * np.pi * rng.uniform(4, 12) * times + rng.uniform(0, 6)) for _ in range(4)]
    return np.stack(waves, axis=1) @ rng.normal(size=(4, 3)) / 2


def turn(rng, start, end, count, rate_hz):
    """Force and rate of a hand's turn from one direction to another, smooth, with accelerations of its own."""
    axis = np.cross(start, end)
    axis = axis / np.linalg.norm(axis) if np.linalg.norm(axis) > 1e-6 else np.cross(start, [0.3, 0.5, 0.81])
    angle = np.arctan2(np.linalg.norm(np.cross(start, end)), start @ end)
    x = np.linspace(0, 1, count)
    share = 10 * x**3 - 15 * x**4 + 6 * x**5
    cos, sin = np.cos(angle * share)[:, None], np.sin(angle * share)[:, None]
    turned = start * cos + np.cross(axis, start) * sin + axis * (axis @ start) * (1 - cos)
    shaken = 0.08 * np.sin(np.pi * x)[:, None] * tremor(rng, count, rate_hz)
    return turned + shaken, np.degrees(np.gradient(angle * share, 1 / rate_hz))[:, None] * axis


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


def ulog(path: Path, s: Session) -> Path:
    """A PX4 log with `sensor_combined` (https://docs.px4.io/main/en/dev_log/ulog_file_format.html)."""

    def message(kind: bytes, content: bytes) -> bytes:
        return struct.pack("<HB", len(content), kind[0]) + content

    fields = "sensor_combined:uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;"
    out = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0), message(b"B", bytes(40)), message(b"F", fields.encode())]
    out.append(message(b"A", struct.pack("<BH", 0, 0) + b"sensor_combined"))
    for time, rate, force in zip(s.time_s, np.radians(s.rate), G * s.force, strict=True):
        out.append(message(b"D", struct.pack("<HQ6f", 0, round(time * 1e6) + 10**6, *rate, *force)))
    path.write_bytes(b"".join(out))
    return path
