"""ROS 1 and ROS 2 bags and MCAP files, by rosbags: a table for each topic with accelerations."""

import contextlib
import mmap
import sqlite3
import struct
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import polars as pl

from tumblecal.data.parquet import PIECE_ROWS
from tumblecal.ground.decoding import decoding
from tumblecal.recordings.damage import Damage
from tumblecal.recordings.table import Reader, Source, Table, library


MCAP_MAGIC, SQLITE_MAGIC = b"\x89MCAP0\r\n", b"SQLite format 3\x00"
# https://mcap.dev/spec: opcode, length; of the footer the starts of the summary and of its offsets, and the CRC-32.
_FOOTER, _DATA_END = struct.Struct("<BQQQI"), struct.Struct("<BQI")
_FOOTER_CODE, _DATA_END_CODE, _CRC_SIZE = 0x02, 0x0F, 4
_PIECE = 1 << 24


def check_bag(path: Path) -> None:
    """Check the files of a bag: `path`, or the files in this folder.

    **Raises:** `ValueError` for a file that is damaged.
    """
    for file in sorted(path.iterdir()) if path.is_dir() else [path]:
        if not file.is_file() or not file.stat().st_size:
            continue
        with file.open("rb") as opened, mmap.mmap(opened.fileno(), 0, access=mmap.ACCESS_READ) as content:
            if content[: len(MCAP_MAGIC)] == MCAP_MAGIC:
                _check_mcap(content)
            elif content[: len(SQLITE_MAGIC)] == SQLITE_MAGIC:
                _check_sqlite(file)


def _check_mcap(content: mmap.mmap) -> None:
    """Compare the CRC-32 of data and summary, if the writer stated them."""
    at = len(content) - len(MCAP_MAGIC) - _FOOTER.size
    if at < 0 or content[-len(MCAP_MAGIC) :] != MCAP_MAGIC:
        raise ValueError("the end of the file is missing")
    code, _, summary, _, stated = _FOOTER.unpack_from(content, at)
    if code != _FOOTER_CODE or not summary <= at:
        raise ValueError("no footer")
    start = summary or at
    if stated and _crc32(content, start, at + _FOOTER.size - _CRC_SIZE) != stated:
        raise ValueError("the CRC-32 of its summary is wrong")
    end = start - _DATA_END.size
    code, _, stated = _DATA_END.unpack_from(content, max(end, 0))
    if code == _DATA_END_CODE and stated and _crc32(content, 0, end) != stated:
        raise ValueError("the CRC-32 of its data is wrong")


def _crc32(content: mmap.mmap, start: int, stop: int) -> int:
    value = 0
    for first in range(start, stop, _PIECE):
        value = zlib.crc32(content[first : min(first + _PIECE, stop)], value)
    return value


def _check_sqlite(path: Path) -> None:
    """Compare the tables with their indices, including the times of messages."""
    with contextlib.closing(sqlite3.connect(f"{path.absolute().as_uri()}?immutable=1", uri=True)) as database:
        try:
            (found,) = database.execute("PRAGMA integrity_check(1)").fetchone()
        except sqlite3.Error as error:
            raise ValueError(str(error)) from error
    if found != "ok":
        raise ValueError(found.splitlines()[-1])


_BEGINS = (b"#ROSBAG V2.0", MCAP_MAGIC, SQLITE_MAGIC)
_ADVICE = "copy it again, or repair it: rosbag reindex, ros2 bag reindex, mcap recover"
_IMU, _TEMPERATURE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/Temperature"
# Types with a vector of acceleration, m/s^2, and its place (REP 103: SI units).
_ACCELERATION = {
    _IMU: "linear_acceleration",
    "geometry_msgs/msg/AccelStamped": "accel.linear",
    "geometry_msgs/msg/Vector3Stamped": "vector",
}
_ROLES = {"time": "time_s", "temperature": "temperature_degc"}
_ROLES |= {f"linear_acceleration.{axis}": f"a{axis}_ms2" for axis in "xyz"}
_ROLES |= {f"angular_velocity.{axis}": f"g{axis}_rads" for axis in "xyz"}


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """An open bag; faults of the library become faults of the file."""
    highlevel, typesys = library("rosbags.highlevel", path), library("rosbags.typesys", path)
    known = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    with decoding(path, "bag", _ADVICE), highlevel.AnyReader([path], default_typestore=known) as bag:
        yield bag


def _read(source: Source) -> list[Table]:
    with decoding(source.path, "bag", _ADVICE):
        check_bag(source.path)
    with _opened(source.path) as bag:
        topics = {c.topic: (c.msgtype, bag.topics[c.topic].msgcount) for c in bag.connections}
    warmth = [topic for topic, (kind, _) in topics.items() if kind == _TEMPERATURE]
    tables = []
    for topic, (kind, count) in topics.items():
        columns = tuple(_ROLES) if kind == _IMU else ("time", *list(_ROLES)[2:5]) if kind in _ACCELERATION else ()
        if kind == _IMU and not warmth:
            columns = tuple(name for name in columns if name != "temperature")
        roles = {name: role for name, role in _ROLES.items() if name in columns}
        first_ns = list[int]()
        pieces = _pieces(source.path, (topic, kind, count), warmth[:1], source.damage, first_ns)
        zero_s = partial(_seconds, first_ns)
        tables.append(Table(topic, columns, pieces, count, roles, words=kind, row_word="message", zero_s=zero_s))
    return tables


def _seconds(first_ns: Sequence[int]) -> float:
    return first_ns[0] * 1e-9 if first_ns else 0.0


def _pieces(path: Path, table: tuple[str, str, int], warmth: list[str], damage: Damage, first_ns: list[int]):
    """The rows of a topic, given by name, type and number of messages; `first_ns`: receives the time of the first."""
    topic, kind, count = table

    def pieces(columns: Sequence[str]) -> Iterator[pl.DataFrame]:
        with _opened(path) as bag:
            rows, temperature, seen = [], float("nan"), 0
            chosen = [c for c in bag.connections if c.topic in (topic, *warmth)]
            for connection, received_ns, data in bag.messages(connections=chosen):
                message = bag.deserialize(data, connection.msgtype)
                if connection.topic != topic:
                    temperature = float(message.temperature)
                    continue
                # A driver without a clock stamps nothing: then the time of reception is used, relative to the first, as
                # ns since 1970 do not fit a float.
                stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec or received_ns
                if not first_ns:
                    first_ns.append(stamp_ns)
                seen += 1
                rows.append(((stamp_ns - first_ns[0]) * 1e-9, temperature, *_values(message, kind)))
                if len(rows) == PIECE_ROWS:
                    yield pl.DataFrame(rows, schema=list(_ROLES)[: len(rows[0])], orient="row").select(columns)
                    rows = []
            if count and seen != count:
                damage.report(f"the bag has {seen} messages of {topic}, but its index states {count}")
            if rows:
                yield pl.DataFrame(rows, schema=list(_ROLES)[: len(rows[0])], orient="row").select(columns)

    return pieces


def _values(message: Any, kind: str) -> tuple[float, ...]:
    force = message
    for name in _ACCELERATION[kind].split("."):
        force = getattr(force, name)
    rate = message.angular_velocity if kind == _IMU else None
    return (force.x, force.y, force.z, *((rate.x, rate.y, rate.z) if rate else ()))


READER = Reader(
    "ROS 1 or ROS 2 bag, MCAP",
    lambda path, head: head.startswith(_BEGINS) or (path.is_dir() and (path / "metadata.yaml").exists()),
    _read,
)
